#!/usr/bin/env python3
"""Runs the project's tests on this machine; the first run sets everything up.

usage: test.py [--lint] [--fast] [--oldest] [pytest arguments]

``--lint`` also runs ruff and mypy and builds the documentation. ``--fast`` leaves out the tests marked as slow.
``--oldest`` runs the unit tests of the packages that compute, draw and read bags in an environment of its own with the
oldest supported versions of numpy, scipy, matplotlib, ... (Python 3.11). Without arguments all tests run: units first,
then several processes over DDS.
"""

import signal
import subprocess
import sys

from _bootstrap import WORKSPACE, ensure

OLDEST = "--oldest"
OLDEST_TESTS = [
    f"src/fsw_{name}/test" for name in ("model", "control", "decentral", "plant", "recorder", "analysis", "experiment")
]
if sys.argv[1:2] in (["-h"], ["--help"]):  # nothing needs to be installed for this
    print(__doc__)
    sys.exit()
ensure(dev=True, oldest=OLDEST in sys.argv, extras=["fmu", "machine", "campaign", "hmi"])


def run(title: str, *command: str) -> int:
    """Run a tool of the environment and return its exit code."""
    print(f"== {title}", flush=True)
    return subprocess.run([sys.executable, "-m", *command], cwd=WORKSPACE).returncode


def main() -> int:
    """Run what was asked for; the exit code is the first that is not 0."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it, and so would nodes
    arguments = sys.argv[1:]
    if OLDEST in arguments:
        arguments.remove(OLDEST)
        return run("pytest with the oldest supported versions", "pytest", *(arguments or OLDEST_TESTS))
    codes = []
    if "--lint" in arguments:
        arguments.remove("--lint")
        codes.append(run("ruff check", "ruff", "check", "."))
        codes.append(run("ruff format", "ruff", "format", "--check", "."))
        codes.append(run("mypy", "mypy"))
        print("== documentation", flush=True)
        codes.append(subprocess.run([sys.executable, WORKSPACE / "scripts" / "build_docs.py", "--check"]).returncode)
    if "--fast" in arguments:
        arguments.remove("--fast")
        arguments = ["-m", "not slow", *arguments]
    codes.append(run("pytest", "pytest", *arguments))
    return next((code for code in codes if code), 0)


if __name__ == "__main__":
    sys.exit(main())
