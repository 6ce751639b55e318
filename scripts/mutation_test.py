#!/usr/bin/env python3
"""Mutation testing of the safety-relevant code: which changes the tests do not notice.

Python by mutmut: supervisor, command gate, validity, synchronizer and gateway, with their pure
tests. C: the limits of both kernels, by the changes in test/mutants.yaml. Message texts are not
changed. The result goes to docs/results/mutation.md, all survivors to mutants.csv beside it;
test/mutants.yaml says why one is tolerated.

Verdicts are kept in out/mutation while the code is the same, so that an interrupted run is
continued and only survivors are run again; remove that folder to start over. Changes that were not
tried are counted separately.

A change in Python takes 0.7 to 1.7 s of processor time, one in C, which is compiled, 4 s
(measured): some 30 minutes for all on two idle cores, hours on busy ones.

usage: mutation_test.py [--only WORD] [--out FILE]
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import NamedTuple

from _bootstrap import SOURCES, WORKSPACE, ensure

ensure(dev=True, extras=["fmu", "machine", "campaign", "hmi", "canister", "mutation"])

import yaml  # noqa: E402

from fsw_analysis.report import table  # noqa: E402
from fsw_control.c_library import compiler  # noqa: E402

MUTANTS = WORKSPACE / "test" / "mutants.yaml"
SCRIPT = Path(__file__)
CACHE = WORKSPACE / "out" / "mutation"
#: mutmut's word for a change for which a run had no time
_NOT_TRIED = "not checked"
RESULT = WORKSPACE / "docs" / "results" / "mutation.md"
#: by package, the modules that are mutated
MODULES = {
    "fsw_supervisor": (
        "arbiter",
        "arbitration",
        "controller_registry",
        "failover",
        "in_force",
        "operator_requests",
        "parameters",
        "safety_monitor",
        "start_up",
        "state_machine",
        "tick",
        "ticks",
    ),
    "fsw_control": (
        "command_gate",
        "validity",
        "message_synchronizer",
        "references",
    ),
    "fsw_machine": ("gateway", "samples"),
}
#: files with tests of these modules elsewhere than in the package's own test folder
ELSEWHERE = {"fsw_control": ("src/fsw_plant/test/test_plant_parts.py",)}
#: tests that start nodes or processes are too slow for thousands of mutants
_NOT_PURE = re.compile(
    r"^\s*(?:import|from) "
    r"(?:rclpy|subprocess|fsw_\w+\.launcher|asyncua|fsw_test_support\.machine)",
    re.M,
)
_CONFIGURATION = """
[tool.mutmut]
source_paths = ["{package}"]
only_mutate = {files}
also_copy = ["tests"]
pytest_add_cli_args = [
    "-q", "-x", "--import-mode=importlib", "-p", "no:cacheprovider",
    "-m", "not slow", "-k", "not diagram",
]
pytest_add_cli_args_test_selection = ["tests"]
use_git_change_detection = false

[tool.pytest.ini_options]
markers = ["slow", "requirement"]
"""
#: what a test finds by chance, it finds again; a failure is enough, no need to find a smaller one
_CONFTEST = """
from hypothesis import Phase, settings

phases = [Phase.explicit, Phase.generate]
settings.register_profile("mutation", derandomize=True, deadline=None, phases=phases)
settings.load_profile("mutation")
"""


class Mutant(NamedTuple):
    """One change of the code, and whether the tests noticed."""

    module: str
    where: str
    change: str
    verdict: str


def prepare(package: str, only: str) -> Path | None:
    """Lay out a package and its tests as mutmut needs them; None if nothing is to be mutated.

    Verdicts of an earlier run are kept in the folder while the package is the same: a change that
    was noticed is not run again, for tests are only added.
    """
    files = [
        f"{package}/{module}.py" for module in MODULES[package] if only in f"{package}/{module}"
    ]
    if not files:
        return None
    folder = CACHE / package
    code = [SCRIPT.with_name("_mutmut.py"), *sorted((SOURCES / package / package).rglob("*.py"))]
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in code)).hexdigest()
    same = (folder / "digest").is_file() and (folder / "digest").read_text() == digest
    for file in [*folder.rglob("*")] if folder.exists() else []:
        if file.is_file() and not (same and file.suffix == ".meta"):
            file.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "digest").write_text(digest)
    shutil.copytree(
        SOURCES / package / package,
        folder / package,
        ignore=shutil.ignore_patterns("__pycache__"),
        dirs_exist_ok=True,
    )
    for source in (SOURCES / package / "test", WORKSPACE / "test" / "invariants"):
        tests = folder / "tests" / source.parent.name
        tests.mkdir(parents=True, exist_ok=True)
        for test in source.glob("*.py"):
            if not test.name.startswith("test_") or not _NOT_PURE.search(
                test.read_text(encoding="utf-8")
            ):
                shutil.copy(test, tests)
    for name in ELSEWHERE.get(package, ()):
        shutil.copy(WORKSPACE / name, folder / "tests")
    (folder / "tests" / "conftest.py").write_text(_CONFTEST, encoding="utf-8")
    (folder / "pyproject.toml").write_text(
        _CONFIGURATION.format(package=package, files=files), encoding="utf-8"
    )
    return folder


def python_mutants(package: str, only: str) -> list[Mutant]:
    """Run mutmut over the modules of a package."""
    folder = prepare(package, only)
    if folder is None:
        return []
    mutmut = [sys.executable, str(SCRIPT.with_name("_mutmut.py"))]
    subprocess.run([*mutmut, "run"], cwd=folder, check=True)
    listing = subprocess.run(
        [*mutmut, "tell"], cwd=folder, capture_output=True, text=True, check=True
    ).stdout
    return [_described(*fields) for fields in json.loads(listing)]


def _described(name: str, verdict: str, difference: str) -> Mutant:
    """A mutant of mutmut as a person would call it."""
    module, _, function = re.sub(r"__mutmut_\d+$", "", name).rpartition(".")
    where = function.removeprefix("x_").removeprefix("xǁ").replace("ǁ", ".")
    lines = [line for line in difference.splitlines() if re.match(r"[+-](?![+-])", line)]
    change = " → ".join(
        " ".join(line[1:].strip() for line in lines if line[0] == sign) for sign in "-+"
    )
    return Mutant(module, where, change, verdict)


def c_mutants(only: str) -> list[Mutant]:
    """Change a limit of a kernel, build it, and run the tests of that kernel's limits.

    A kill is kept.
    """
    result = []
    kept = CACHE / "killed.json"
    killed = set(json.loads(kept.read_text(encoding="utf-8"))) if kept.exists() else set()
    for entry in yaml.safe_load(MUTANTS.read_text(encoding="utf-8"))["c"]:
        package = entry["file"].split("/")[1]
        if only not in entry["file"]:
            continue
        with tempfile.TemporaryDirectory() as text:
            folder = Path(text)
            shutil.copytree(
                SOURCES / package / package,
                folder / package,
                ignore=shutil.ignore_patterns("__pycache__"),
            )
            file = folder / Path(entry["file"]).relative_to(Path("src") / package)
            code = file.read_text(encoding="utf-8")
            if code.count(entry["old"]) != 1:
                raise SystemExit(
                    f"{MUTANTS.name}: {entry['old']!r} is not there once in {entry['file']}"
                )
            changed = code.replace(entry["old"], entry["new"])
            file.write_text(changed, encoding="utf-8")
            key = hashlib.sha256(f"{entry['file']}\0{changed}".encode()).hexdigest()
            if key in killed:
                result.append(_c_mutant(entry, "killed"))
                continue
            run = _run_tests(folder, entry["tests"])
            if (
                run.returncode > 1 or "did not compile" in run.stdout
            ):  # a mutant that cannot be run shows nothing
                raise SystemExit(
                    f"{entry['new']!r} in {entry['file']} is no mutant:\n{run.stdout}"
                )
            result.append(_c_mutant(entry, "killed" if run.returncode else "survived"))
            print(f"{result[-1].verdict}: {result[-1].change}", flush=True)
            if run.returncode:
                killed.add(key)
                CACHE.mkdir(parents=True, exist_ok=True)
                kept.write_text(json.dumps(sorted(killed)), encoding="utf-8")
    return result


def _run_tests(folder: Path, tests: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run tests with the changed package in ``folder``."""
    (folder / "no_shrinking.py").write_text(_CONFTEST, encoding="utf-8")
    environment = {
        **os.environ,
        "PYTHONPATH": str(folder),
        "XDG_CACHE_HOME": str(folder / "cache"),
        "CC": shlex.join(["sh", str(_quick_compiler(folder))]),
    }
    command = [sys.executable, *shlex.split("-m pytest -q -x -p no:cacheprovider -p no_shrinking")]
    return subprocess.run(
        [*command, *tests],
        cwd=WORKSPACE,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def _quick_compiler(folder: Path) -> Path:
    """A script that compiles as usual, but optimises little.

    Its flag is the last one, which counts.
    """
    script = folder / "quick_cc"
    script.write_text(f'exec {shlex.join(compiler() or ["cc"])} "$@" -O1\n', encoding="utf-8")
    return script


def _c_mutant(entry: dict[str, str], verdict: str) -> Mutant:
    package, name = entry["file"].split("/")[1], Path(entry["file"]).name
    return Mutant(f"{package}.{name}", entry["where"], f"{entry['old']} → {entry['new']}", verdict)


def reason(mutant: Mutant, tolerated: list[dict[str, str]]) -> str:
    """Why a survivor is tolerated; empty if nothing says so."""
    where, change = f"{mutant.module}.{mutant.where}", mutant.change
    fitting = (
        entry["reason"]
        for entry in tolerated
        if re.search(entry.get("where", ""), where) and re.search(entry.get("change", ""), change)
    )
    return next(fitting, "")


def page(mutants: list[Mutant], tolerated: list[dict[str, str]]) -> str:
    """The result as Markdown."""
    left = [
        (mutant, reason(mutant, tolerated))
        for mutant in mutants
        if not is_noticed(mutant) and mutant.verdict != _NOT_TRIED
    ]
    lines = [
        "# Mutation testing",
        "",
        "Would the tests notice a mistake in the safety-relevant code? `python3 "
        "scripts/mutation_test.py` makes small",
        "changes to that code, one at a time, and runs its tests: a comparison reversed, "
        "a limit removed, a number",
        "incremented. A change is noticed if a test fails or hangs, "
        "and survives if all tests pass. Message texts are",
        "not changed. The changes of the C kernels (`.c`, `.h`) are listed by hand, "
        "about one for each limit.",
        "",
        "Some changes make no difference in practice, for example at exactly the number at which "
        "`<` and `<=` differ.",
        "These are tolerated, each for a stated reason, but still count as not noticed.",
        "",
    ]
    columns = (
        "changes",
        "not tried",
        "noticed",
        "tolerated",
        "survived",
        "noticed of those tried [%]",
    )
    rows: list[tuple[object, ...]] = [("module", *columns)]
    for module in [*dict.fromkeys(mutant.module for mutant in mutants), ""]:
        here = [mutant for mutant in mutants if not module or mutant.module == module]
        tried = sum(mutant.verdict != _NOT_TRIED for mutant in here)
        kinds = Counter(
            "tolerated" if why else "survived"
            for mutant, why in left
            if not module or mutant.module == module
        )
        noticed = tried - kinds.total()
        share = f"{100.0 * noticed / tried:.1f}" if tried else ""
        counts = (len(here), len(here) - tried, noticed, kinds["tolerated"], kinds["survived"])
        rows.append((f"`{module}`" if module else "all", *counts, share))
    lines += [
        table(rows),
        "",
        "All changes that were not noticed, with the reason where one is "
        "tolerated: [mutants.csv](mutants.csv).",
    ]
    return "\n".join(lines) + "\n"


def listing(mutants: list[Mutant], tolerated: list[dict[str, str]]) -> str:
    """The changes that were not noticed, as CSV; first those that a test should notice."""
    left = [
        (reason(mutant, tolerated), mutant)
        for mutant in mutants
        if not is_noticed(mutant) and mutant.verdict != _NOT_TRIED
    ]
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["where", "change", "reached by a test", "why it is tolerated"])
    for why, mutant in sorted(left, key=lambda entry: bool(entry[0])):
        rows.writerow(
            [f"{mutant.module}.{mutant.where}", mutant.change, mutant.verdict != "no tests", why]
        )
    return text.getvalue()


def is_noticed(mutant: Mutant) -> bool:
    """Whether the tests fail or hang with this change."""
    return mutant.verdict in (
        "killed",
        "timeout",
        "segfault",
        "suspicious",
        "caught by type check",
    )


def main() -> int:
    """Run all and write the result.

    The exit code is 1 when less than nine in ten changes are noticed.
    """
    command = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    command.add_argument(
        "--only",
        default="",
        help="only files whose path has this word; writes no result without --out",
    )
    command.add_argument("--out", type=Path, help=f"default: {RESULT.relative_to(WORKSPACE)}")
    arguments = command.parse_args()
    # threads of the matrix library on as many processors as there are wait for each other for most
    # of the time
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    mutants = [mutant for package in MODULES for mutant in python_mutants(package, arguments.only)]
    mutants += c_mutants(arguments.only)
    tolerated = yaml.safe_load(MUTANTS.read_text(encoding="utf-8"))["tolerated"]
    text, unnoticed = page(mutants, tolerated), listing(mutants, tolerated)
    out = arguments.out or (None if arguments.only else RESULT)
    if out is not None:
        out.write_text(text, encoding="utf-8")
        out.with_name("mutants.csv").write_text(unnoticed, encoding="utf-8")
    print(text, unnoticed, sep="\n")
    return int(sum(map(is_noticed, mutants)) < 0.9 * len(mutants))


if __name__ == "__main__":
    sys.exit(main())
