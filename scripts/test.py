#!/usr/bin/env python3
"""Runs the project's tests on this machine; the first run sets everything up.

usage: test.py [--full] [--lint] [--fast] [--core] [--oldest] [pytest arguments]

Without arguments all tests run that need no minutes of computing, several at a time, and those
against the clock after the others. ``--full`` runs these, too: sanitizers, other processors, FMUs,
comparisons, tuning. ``--fast`` leaves out all tests marked as slow. ``--lint`` also runs ruff,
mypy and, on the operator's page, tsc and ESLint, and builds the documentation. ``--core`` runs
README's demo and the core's fast tests in a copy without quality and lab, and nothing else; with
``--lint`` or ``--full`` the other tests follow.
``--oldest`` runs the tests of the packages that compute, draw and read bags in an environment of
its own with the oldest supported versions of numpy, scipy, matplotlib, ... (Python 3.11); with
``--fast`` in a minute. Where pytest gets arguments (paths, -k, -m), the tests that these choose
run one after another.
"""

import os
import signal
import subprocess
import sys
import tempfile

from _bootstrap import (
    NEWER_TEST_EXTRAS,
    TEST_EXTRAS,
    WORKSPACE,
    ensure,
    prefer_a_python_of_the_wheels,
    why_no_middleware,
)

OLDEST = "--oldest"
#: Most tests of processes wait for each other, so that a core has room for three. The tests of a
#: file stay together: they share fixtures, and those of a launch file come one after the other.
#: Files come in the order of ``testpaths``.
BY_FILE = ["--dist", "loadfile", "--no-loadscope-reorder"]
PARALLEL = ["-n", str(min(8, 2 * (os.cpu_count() or 1))), *BY_FILE]
#: Graphs against the clock, after all others: only their folders are collected, those of the
#: longest files first.
REAL_TIME = [
    "test/machine",
    "test/hmi",
    "test/faults",
    "test/launch",
    "-n",
    str(min(4, 1 + (os.cpu_count() or 1))),
    *BY_FILE,
]
OLDEST_PACKAGES = ["model", "control", "decentral", "plant", "recorder", "analysis", "scenario"]
#: Campaigns need pyarrow, and that a newer numpy.
NO_CAMPAIGN = ["--ignore", "lab/fsw_lab/test/test_lab_campaign.py", "-k", "not campaign"]
OLDEST_LAB = [
    "lab/fsw_identification/test",
    "lab/fsw_tuning/test",
    "lab/fsw_lab/test",
    "quality/fsw_quality/test",
]
OLDEST_TESTS = [
    *(f"src/fsw_{name}/test" for name in OLDEST_PACKAGES),
    "src/fsw/test",
    *OLDEST_LAB,
    *NO_CAMPAIGN,
]
if sys.argv[1:2] in (["-h"], ["--help"]):  # nothing needs to be installed for this
    print(__doc__)
    sys.exit()
prefer_a_python_of_the_wheels()
if reason := why_no_middleware():
    sys.exit(f"the tests need ROS 2: {reason}")
extras = TEST_EXTRAS if OLDEST in sys.argv else (*TEST_EXTRAS, *NEWER_TEST_EXTRAS)
ensure(dev=True, oldest=OLDEST in sys.argv, extras=extras)


def run(title: str, *command: str) -> int:
    """Run a tool of the environment and return its exit code."""
    print(f"== {title}", flush=True)
    return subprocess.run([sys.executable, "-m", *command], cwd=WORKSPACE).returncode


def rewrite_assertions() -> None:
    """Let pytest prepare all files of tests, in two halves.

    At the first run each worker would do all of it.
    """
    if any((WORKSPACE / "test" / "__pycache__").glob("*-pytest-*.pyc")):
        return
    print("== preparing the tests", flush=True)
    collect = [sys.executable, "-m", "pytest", "--collect-only", "-qq"]
    halves = (["test", "quality", "lab"], ["src"])
    running = [
        subprocess.Popen([*collect, *half], cwd=WORKSPACE, stdout=subprocess.DEVNULL)
        for half in halves
    ]
    for process in running:
        process.wait()


def lint() -> list[int]:
    """Exit codes of lint, types and documentation, which is built beside the others."""
    from _page_lint import lint as lint_page  # not needed for --help

    build = [sys.executable, str(WORKSPACE / "scripts" / "build_docs.py"), "--check"]
    with tempfile.TemporaryFile() as said:
        docs = subprocess.Popen(build, stdout=said, stderr=subprocess.STDOUT)
        codes = [
            run("ruff check", "ruff", "check", "."),
            run("ruff format", "ruff", "format", "--check", "."),
            run("mypy", "mypy"),
            lint_page(),
            docs.wait(),
        ]
        said.seek(0)
        print("== documentation\n" + said.read().decode(), end="", flush=True)
    return codes


def main() -> int:
    """Run what was asked for; the exit code is the first that is not 0."""
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a shell's background jobs ignore it, and so would nodes
    os.environ.pop(
        "PYTHONDONTWRITEBYTECODE", None
    )  # else each of a thousand processes would compile what it imports
    arguments = sys.argv[1:]
    full, fast = "--full" in arguments, "--fast" in arguments
    profile = ["--hypothesis-profile=full"] if full else []
    codes, chosen = [], "" if full else " and not full"
    if "--core" in arguments:
        from _core import check

        codes.append(check(profile))
        if not full and "--lint" not in arguments:
            return codes[0]
        arguments.remove("--core")
        chosen += " and not core"
    if OLDEST in arguments:
        chosen = "not slow and not full" if "--fast" in arguments else "not full"
        arguments = [argument for argument in arguments if argument not in (OLDEST, "--fast")]
        given = arguments or [*OLDEST_TESTS, *PARALLEL]
        return run("pytest with the oldest supported versions", "pytest", "-m", chosen, *given)
    if "--lint" in arguments:
        arguments.remove("--lint")
        codes += lint()
    arguments = [argument for argument in arguments if argument not in ("--full", "--fast")]
    if arguments or fast:
        codes.append(
            run(
                "pytest", "pytest", *(["-m", "not slow"] if fast else []), *(arguments or PARALLEL)
            )
        )
    else:
        rewrite_assertions()
        codes.append(run("pytest", "pytest", *PARALLEL, *profile, "-m", f"not real_time{chosen}"))
        codes.append(run("pytest in real time", "pytest", *REAL_TIME, "-m", f"real_time{chosen}"))
    return next((code for code in codes if code), 0)


if __name__ == "__main__":
    sys.exit(main())
