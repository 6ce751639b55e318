#!/usr/bin/env python3
"""Runs the gallery's notebooks and writes their pages, with output and figures.

usage: build_gallery.py [--out FOLDER] [NAME ...]

The notebooks are the scripts in examples/gallery, in cells that begin with ``# %%`` as Jupytext,
VS Code and Spyder know them; ``jupytext --to ipynb`` makes Jupyter's of them.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from _bootstrap import WORKSPACE, ensure

if __name__ == "__main__":
    ensure(extras=("science", "campaign", "canister"))

NOTEBOOKS = WORKSPACE / "examples" / "gallery"
NOTE = "<!-- Written by scripts/build_gallery.py. Change the notebook, not this page. -->"


def cells(text: str) -> list[tuple[bool, str]]:
    """Whether each cell is text, and its content."""
    parts = []
    for part in re.split(r"^# %%", text, flags=re.MULTILINE)[1:]:
        kind, _, content = part.partition("\n")
        if "[markdown]" in kind:
            content = re.sub(r"^# ?", "", content, flags=re.MULTILINE)
        parts.append(("[markdown]" in kind, content.strip()))
    return parts


class Page:
    """The page of a notebook that is being run; figures go beside it."""

    def __init__(self, name: str, folder: Path) -> None:
        self._name, self._folder, self._figures = name, folder, 0
        self.lines: list[str] = []
        # the ``__main__`` of processes that a notebook starts is this script's, which does nothing
        # there
        self._names: dict[str, Any] = {"__name__": name}

    def run(self, code: str) -> None:
        """Run a cell and show what it prints, and what its last line is."""
        tree = ast.parse(code)
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        printed = io.StringIO()
        with redirect_stdout(printed):
            exec(compile(tree, self._name, "exec"), self._names)
            value = (
                eval(compile(ast.Expression(last.value), self._name, "eval"), self._names)
                if last
                else None
            )
        self.lines += ["```python", code, "```", ""]
        if printed.getvalue():
            self.lines += ["```", printed.getvalue().rstrip(), "```", ""]
        self._show(value)

    def _show(self, value: Any) -> None:
        if hasattr(value, "savefig"):
            self._figures += 1
            file = f"{self._name}_{self._figures}.png"
            value.savefig(self._folder / file, dpi=80)
            title = self.lines[0].partition("\n")[0].lstrip("# ")
            self.lines += [f"![{title}, figure {self._figures}]({file})", ""]
        elif hasattr(value, "_repr_markdown_"):
            self.lines += [value._repr_markdown_(), ""]
        elif value is not None:
            self.lines += ["```", str(value), "```", ""]


def build(name: str, folder: Path) -> float:
    """Run a notebook and write its page; returns how long it took [s]."""
    began = time.monotonic()
    page = Page(name, folder)
    for is_text, content in cells((NOTEBOOKS / f"{name}.py").read_text(encoding="utf-8")):
        if is_text:
            page.lines += [content, ""]
        elif content:
            page.run(content)
    title, *rest = page.lines[0].split("\n")
    source = f"The notebook is `examples/gallery/{name}.py`."
    text = "\n".join([title, "", NOTE, *rest, "", *page.lines[1:], source, ""])
    parts = re.split(r"(^```.*?^```$)", text, flags=re.MULTILINE | re.DOTALL)
    parts[::2] = [re.sub(r"\n{3,}", "\n\n", part) for part in parts[::2]]  # code stays as it is
    (folder / f"{name}.md").write_text("".join(parts), encoding="utf-8")
    return time.monotonic() - began


def main(arguments: Sequence[str] | None = None) -> int:
    """Build the pages; returns the exit code."""
    known = sorted(path.stem for path in NOTEBOOKS.glob("*.py"))
    cli = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    cli.add_argument(
        "--out",
        type=Path,
        default=WORKSPACE / "docs" / "gallery",
        help="folder (default docs/gallery)",
    )
    cli.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(known)} (default: all)"
    )
    parsed = cli.parse_args(arguments)
    if unknown := set(parsed.names) - set(known):
        cli.error(f"no notebook {', '.join(sorted(unknown))}")
    parsed.out.mkdir(parents=True, exist_ok=True)
    for name in parsed.names or known:
        print(f"{name:<20} {build(name, parsed.out):6.1f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
