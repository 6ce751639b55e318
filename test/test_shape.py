"""No unit is too long to be read at a time, and modules are not cut into crumbs."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest

WORKSPACE = Path(__file__).resolve().parents[1]
#: folders with templates
TEMPLATES = ("src", "quality", "lab", "benchmarks", "scripts")
#: columns of a line, as ruff has them for Python
COLUMNS = 99
#: modules of fewer than 60 lines without a reason by rule; only ever fewer
MOST_SHORT_MODULES = 3


@pytest.fixture
def counter(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(WORKSPACE / "scripts"))
    return importlib.import_module("count_lines")


def test_functions_classes_and_files_keep_their_limits(counter: ModuleType) -> None:
    assert counter.too_long() == []


def test_short_modules_only_become_fewer(counter: ModuleType) -> None:
    assert len(counter.short_modules()) <= MOST_SHORT_MODULES


def test_lines_of_templates_fit_the_columns() -> None:
    files = [path for top in TEMPLATES for path in (WORKSPACE / top).rglob("*.j2")]
    wide = [
        f"{path.relative_to(WORKSPACE)}:{number}"
        for path in files
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > COLUMNS
    ]
    assert len(files) > 30 and wide == []


@pytest.mark.parametrize(
    ("lines", "units"), [(60, []), (61, ["function long in m.py"])], ids=["at", "over"]
)
def test_docstrings_and_comments_do_not_count(
    counter: ModuleType, lines: int, units: list[str]
) -> None:
    body = "    pass\n    # why\n\n" * (lines - 1)
    text = f'def long():\n    """What it does.\n\n    And how.\n    """\n{body}'
    assert [unit for _, unit in counter.excesses("m.py", text)] == units
    assert [size for size, _ in counter.excesses("m.py", text)] == [lines] * len(units)


def test_long_classes_and_files_are_seen(counter: ModuleType) -> None:
    text = "class Long:\n" + "    x = 1\n" * 400
    assert list(counter.excesses("m.py", text)) == [
        (401, "file m.py"),
        (401, "class Long in m.py"),
    ]
