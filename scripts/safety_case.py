"""The safety case: each requirement of docs/concepts/safety.yaml with the tests that are marked with it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parent.parent
PAGE = WORKSPACE / "docs" / "concepts" / "safety.md"
REQUIREMENTS = PAGE.with_suffix(".yaml")
TABLE = PAGE.with_name("safety-requirements.md")
TESTS = ("src/*/test", "test", "runtime/*/test")
HEAD = """# Safety requirements and their tests

The requirements of [the safety case](safety.md), from `docs/concepts/safety.yaml`, each with the tests that are marked
with it, for example by `@pytest.mark.requirement("S1")`. `scripts/test.py --lint` fails when a requirement has no test,
when a mark names an unknown requirement, or when a requirement belongs to no hazard of the safety case.
"""


def marked(paths: Iterable[Path] | None = None, full: bool = True) -> dict[str, list[tuple[Path, str]]]:
    """Tests by the requirement in ``@pytest.mark.requirement("S1", ...)``; by default the project's. Imports none.

    Without ``full`` those are left out that only ``scripts/test.py --full`` runs.
    """
    found: dict[str, list[tuple[Path, str]]] = {}
    for path in test_files() if paths is None else paths:
        text = path.read_text(encoding="utf-8")
        if not full and re.search(r"^pytestmark = .*pytest\.mark\.full\b", text, re.MULTILINE):
            continue
        for node in ast.walk(_tree(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                if not full and "pytest.mark.full" in map(ast.unparse, node.decorator_list):
                    continue
                for mark in node.decorator_list:
                    if isinstance(mark, ast.Call) and ast.unparse(mark.func) == "pytest.mark.requirement":
                        for one in mark.args:
                            found.setdefault(str(ast.literal_eval(one)), []).append((path, node.name))
    return found


@cache
def _tree(text: str) -> ast.Module:
    return ast.parse(text)


def test_files() -> list[Path]:
    """All files with tests."""
    folders = [folder for pattern in TESTS for folder in sorted(WORKSPACE.glob(pattern))]
    return [path for folder in folders for path in sorted(folder.rglob("*.py")) if "test" in path.name]


def faults(requirements: Mapping[str, str], tests: Mapping[str, list[tuple[Path, str]]], page: str) -> list[str]:
    """What is wrong with the safety case, whose hazards are on a page; one line each."""
    named = set(re.findall(r"\bS\d+\b", page))
    found = [f"{one}: no test has @pytest.mark.requirement({one!r})" for one in requirements if one not in tests]
    found += [f"{one}: in no hazard of {PAGE.name}" for one in requirements if one not in named]
    found += [f"{one}: {PAGE.name} names it, {REQUIREMENTS.name} does not" for one in sorted(named - set(requirements))]
    for one in sorted(set(tests) - set(requirements)):
        places = ", ".join(f"{path.name}::{name}" for path, name in tests[one])
        found.append(f"{one}: the mark of {places} names no requirement of {REQUIREMENTS.name}")
    return found


def table(requirements: Mapping[str, str], tests: Mapping[str, list[tuple[Path, str]]]) -> str:
    """Requirements and their tests as Markdown."""
    lines = [HEAD, "| | requirement | tests |", "|---|---|---|"]
    for one, text in requirements.items():
        files: dict[str, list[str]] = {}
        for path, name in sorted(tests.get(one, [])):
            files.setdefault(path.name, []).append(f"`{name}`")
        shown = "<br>".join(f"{name}: {', '.join(sorted(set(names)))}" for name, names in files.items())
        lines.append(f"| {one} | {' '.join(text.split())} | {shown} |")
    return "\n".join([*lines, ""])
