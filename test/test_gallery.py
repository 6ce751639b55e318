"""The gallery: every notebook has its page, and the cheapest run as they are.

With ``FSW_ALL_BLOCKS`` in the environment all of them.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

WORKSPACE = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((WORKSPACE / "examples" / "gallery").glob("*.py"))
PAGES = WORKSPACE / "docs" / "gallery"


def code_of(page):
    return re.findall(
        r"^```python\n(.*?)\n```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_page_shows_the_notebook_as_it_is(notebook):
    page, text = PAGES / f"{notebook.stem}.md", notebook.read_text(encoding="utf-8")
    cells = [part.partition("\n") for part in re.split(r"^# %%", text, flags=re.MULTILINE)[1:]]
    assert code_of(page) == [
        content.strip() for kind, _, content in cells if "markdown" not in kind
    ]
    shown = re.findall(r"!\[[^]]+, figure \d\]\((.*?)\)", page.read_text(encoding="utf-8"))
    assert shown == [path.name for path in sorted(PAGES.glob(f"{notebook.stem}_[0-9].png"))]
    guide = (PAGES.parent / "how-to" / "python.md").read_text("utf-8")
    assert f"(../gallery/{notebook.stem}.md)" in guide


@pytest.mark.slow
@pytest.mark.full
def test_notebooks_run(tmp_path):
    for module in ("pandas", "control"):
        pytest.importorskip(module)
    names = ["first_weld", "decoupling", "own_controller"]
    if "FSW_ALL_BLOCKS" in os.environ:
        names = [path.stem for path in NOTEBOOKS]
    script = WORKSPACE / "scripts" / "build_gallery.py"
    subprocess.run([sys.executable, script, "--out", tmp_path, *names], check=True, timeout=1100)
    for name in names:
        assert code_of(tmp_path / f"{name}.md") == code_of(PAGES / f"{name}.md")
        for figure in PAGES.glob(f"{name}_[0-9].png"):
            assert (tmp_path / figure.name).stat().st_size > 10_000
