#!/usr/bin/env python3
"""The safety case.

Each requirement of docs/concepts/safety.yaml with its tests and the outcome of their last run.

usage: safety_case.py --publish [pytest arguments]

``--publish`` runs the tests that are marked with a requirement, one after another, and writes the
outcome with the commit into docs/results/safety_tests.json; arguments choose among them, e.g. ``-m
"requirement and not real_time"``. Then run ``scripts/build_docs.py``, which writes the tables. It
fails on a tree with changes that are not committed.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    if sys.argv[1:2] != ["--publish"]:
        sys.exit(__doc__)
    from _bootstrap import NEWER_TEST_EXTRAS, TEST_EXTRAS, ensure

    ensure(dev=True, extras=(*TEST_EXTRAS, *NEWER_TEST_EXTRAS))

from fsw_analysis import report

WORKSPACE = Path(__file__).resolve().parent.parent
PAGE = WORKSPACE / "docs" / "concepts" / "safety.md"
REQUIREMENTS = PAGE.with_suffix(".yaml")
RESULTS = WORKSPACE / "docs" / "results" / "safety_tests.json"
REACTIONS = RESULTS.with_name("reaction_times.json")
#: values beyond it are not those of a weld: the model has left the range in which it holds
_MODEL_HOLDS = {"mm": 10.0, "°C": 1083.0, "kN": 200.0, "N·m": 5000.0}
TESTS = ("src/*/test", "quality/*/test", "lab/*/test", "test", "quality/test", "lab/test")
#: ``left out``: not chosen by the arguments
KINDS = ("passed", "failed", "skipped", "left out")
HEAD = """# Safety requirements and their tests

The requirements of [the safety case](safety.md), from `docs/concepts/safety.yaml`, each with the
tests that are marked with it, for example by `@pytest.mark.requirement("S1")`.
`scripts/test.py --lint` fails when a requirement has no test, when a mark names an unknown
requirement, or when a requirement belongs to no hazard of the safety case.
`scripts/safety_case.py --publish` runs the tests and writes the last column.
"""


def marked(
    paths: Iterable[Path] | None = None, full: bool = True
) -> dict[str, list[tuple[Path, str]]]:
    """Tests by the requirement in ``@pytest.mark.requirement("S1", ...)``.

    By default the project's. Imports none.

    Without ``full`` those are left out that only ``scripts/test.py --full`` runs.
    """
    marks: dict[str, list[tuple[Path, str]]] = {}
    for path in test_files() if paths is None else paths:
        text = path.read_text(encoding="utf-8")
        if not full and re.search(r"^pytestmark = .*pytest\.mark\.full\b", text, re.MULTILINE):
            continue
        for node in ast.walk(_tree(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                if not full and "pytest.mark.full" in map(ast.unparse, node.decorator_list):
                    continue
                for mark in node.decorator_list:
                    if (
                        isinstance(mark, ast.Call)
                        and ast.unparse(mark.func) == "pytest.mark.requirement"
                    ):
                        for argument in mark.args:
                            marks.setdefault(str(ast.literal_eval(argument)), []).append(
                                (path, node.name)
                            )
    return marks


@cache
def _tree(text: str) -> ast.Module:
    return ast.parse(text)


def test_files() -> list[Path]:
    """All files with tests."""
    folders = [folder for pattern in TESTS for folder in sorted(WORKSPACE.glob(pattern))]
    return [
        path for folder in folders for path in sorted(folder.rglob("*.py")) if "test" in path.name
    ]


def faults(
    requirements: Mapping[str, str], tests: Mapping[str, list[tuple[Path, str]]], page: str
) -> list[str]:
    """What is wrong with the safety case, whose hazards are on a page; one line each."""
    named = set(re.findall(r"\bS\d+\b", page))
    gaps = [
        f"{requirement}: no test has @pytest.mark.requirement({requirement!r})"
        for requirement in requirements
        if requirement not in tests
    ]
    gaps += [
        f"{requirement}: in no hazard of {PAGE.name}"
        for requirement in requirements
        if requirement not in named
    ]
    gaps += [
        f"{requirement}: {PAGE.name} names it, {REQUIREMENTS.name} does not"
        for requirement in sorted(named - set(requirements))
    ]
    for requirement in sorted(set(tests) - set(requirements)):
        places = ", ".join(f"{path.name}::{name}" for path, name in tests[requirement])
        gaps.append(
            f"{requirement}: the mark of {places} names no requirement of {REQUIREMENTS.name}"
        )
    return gaps


def table(
    requirements: Mapping[str, str],
    tests: Mapping[str, list[tuple[Path, str]]],
    results: Mapping[str, Any],
) -> str:
    """Requirements, their tests and the last outcome as Markdown."""
    rows = [("", "requirement", "tests", "last run")]
    for requirement, text in requirements.items():
        files: dict[str, list[str]] = {}
        for path, name in sorted(tests.get(requirement, [])):
            files.setdefault(path.name, []).append(f"`{name}`")
        shown = "<br>".join(
            f"{name}: {', '.join(sorted(set(names)))}" for name, names in files.items()
        )
        rows.append((requirement, " ".join(text.split()), shown, outcome(results, requirement)))
    return "\n".join([HEAD, *_last_run(results), "", report.table(rows, words=None), ""])


def outcome(results: Mapping[str, Any], requirement: str) -> str:
    """Outcome of the last run of a requirement's tests, in a few words."""
    counts = results["requirements"].get(requirement, {})
    words = [f"{counts[kind]} {kind}" for kind in KINDS if counts.get(kind)]
    return ", ".join(words) or "not run"


def _last_run(results: Mapping[str, Any]) -> list[str]:
    return [f"Last run: commit `{results['commit']}`, {results['date']}, `{results['chosen']}`."]


def _verdict(counts: Mapping[str, int]) -> str:
    """One word or two for a requirement; a test that was skipped or left out shows nothing."""
    if counts.get("failed"):
        return "failed"
    if not counts.get("passed"):
        return "skipped" if counts.get("skipped") else "not run"
    return "passed in part" if counts.get("skipped") or counts.get("left out") else "passed"


def load_results() -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Outcomes of the tests and reaction times, as they were written last."""
    tests, reactions = (
        json.loads(path.read_text(encoding="utf-8")) for path in (RESULTS, REACTIONS)
    )
    return tests, reactions


def with_tables(
    page: str,
    requirements: Iterable[str],
    results: Mapping[str, Any],
    reactions: Mapping[str, Any],
) -> str:
    """The page of the safety case with its generated tables as they are now."""
    groups: dict[str, list[str]] = {
        "passed": [],
        "failed": [],
        "passed in part": [],
        "skipped": [],
        "not run": [],
    }
    for requirement in requirements:
        groups[_verdict(results["requirements"].get(requirement, {}))].append(requirement)
    total, passed = sum(map(len, groups.values())), len(groups.pop("passed"))
    rest = "; ".join(f"{name}: {', '.join(ones) or 'none'}" for name, ones in groups.items())
    summary = f"Passed with all their tests: {passed} of {total} requirements; {rest}."
    tables = {
        "reaction times": reaction_table(reactions),
        "last run": "\n".join([*_last_run(results), summary]),
    }
    for name, text in tables.items():
        pattern = rf"(<!-- {name}: begin -->\n).*?(\n<!-- {name}: end -->)"
        page = re.sub(
            pattern,
            lambda match, text=text: f"{match[1]}\n{text}\n{match[2]}",
            page,
            flags=re.DOTALL,
        )
    return page


def reaction_table(reactions: Mapping[str, Any]) -> str:
    """Measured times as Markdown."""
    columns = ("reaction", "process safety time", "peak with / without reaction")
    cells = [("hazard", "fault", "limit", "by", *columns)]
    for row in reactions["rows"]:
        limit = row["limit"].split(" ", 1)
        times = [
            f"{row[key]:g} s" if row[key] is not None else "–"
            for key in ("reaction_s", "process_safety_s")
        ]
        by = row["by"] or "**no reaction**"
        peaks = " / ".join(
            _peak(row[f"worst_{key}_reaction"], row["unit"]) for key in ("with", "without")
        )
        cells.append((row["hazard"], row["fault"], limit[1], by, *times, peaks))
    return "\n".join([report.table(cells, words=4), "", _coverage(reactions["rows"])])


def _coverage(rows: Sequence[Mapping[str, Any]]) -> str:
    """How many faults end well, in words: of those that pass a limit if nothing reacts."""
    dangerous = [row for row in rows if row["process_safety_s"] is not None]
    inside = sum(row["reaction_s"] is not None and row["beyond_s"] == 0.0 for row in dangerous)
    stopped = sum(row["reaction_s"] is not None for row in dangerous)
    return (
        f"Of {len(rows)} faults, {len(dangerous)} pass a limit within 120 s if nothing reacts. "
        f"Of these, {inside} stay inside it, {stopped - inside} are stopped after it was passed, "
        f"{len(dangerous) - stopped} not at all: a coverage of {100 * inside // len(dangerous)} % "
        f"inside the limit, of {100 * stopped // len(dangerous)} % at all."
    )


def _peak(value: float, unit: str) -> str:
    return f"{value:g} {unit}" if abs(value) <= _MODEL_HOLDS[unit] else "unbounded"


class _Outcomes:
    """Counts what becomes of the tests of each requirement: a plugin of pytest."""

    def __init__(self) -> None:
        self.counts: dict[str, dict[str, int]] = {}
        self._of: dict[str, set[str]] = {}

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        for item in items:
            self._of[item.nodeid] = _requirements(item)

    def pytest_deselected(self, items: list[Any]) -> None:
        for item in items:
            self._count(_requirements(item), "left out")

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call" or report.outcome != "passed":
            self._count(self._of.get(report.nodeid, set()), report.outcome)

    def _count(self, requirements: Iterable[str], kind: str) -> None:
        for requirement in requirements:
            counts = self.counts.setdefault(requirement, dict.fromkeys(KINDS, 0))
            counts[kind] += 1


def _requirements(item: Any) -> set[str]:
    """The requirements that a test is marked with."""
    return {str(name) for mark in item.iter_markers("requirement") for name in mark.args}


def publish(arguments: list[str]) -> int:
    """Run the tests of all requirements and write the outcome; returns pytest's exit code."""
    import pytest

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words], cwd=WORKSPACE, check=True, capture_output=True, text=True
        ).stdout.strip()

    if git("status", "--porcelain", "--untracked-files=no"):
        print(
            "safety_case.py: commit the changes first: the outcome is published with its commit",
            file=sys.stderr,
        )
        return 2
    chosen = arguments or ["-m", "requirement and not full"]
    commit, date = git("rev-parse", "--short=10", "HEAD"), git("show", "-s", "--format=%cs")
    outcomes = _Outcomes()
    code = pytest.main([*chosen, "-q", "-p", "no:cacheprovider"], plugins=[outcomes])
    order = sorted(outcomes.counts, key=lambda requirement: int(requirement[1:]))
    content = {
        "commit": commit,
        "date": date,
        "chosen": " ".join(f'"{word}"' if " " in word else word for word in ["pytest", *chosen]),
        "requirements": {requirement: outcomes.counts[requirement] for requirement in order},
    }
    RESULTS.write_text(report.numbers(content), encoding="utf-8")
    return int(code)


if __name__ == "__main__":
    sys.exit(publish(sys.argv[2:]))
