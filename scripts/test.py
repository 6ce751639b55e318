#!/usr/bin/env python3
"""Runs the project's tests on this machine; the first run sets everything up.

usage: test.py [--lint] [pytest arguments]

``--lint`` also runs ruff and mypy. Without arguments all tests run: units first, then several processes over DDS.
"""

import subprocess
import sys

from _bootstrap import WORKSPACE, ensure

ensure(dev=True)


def run(title: str, *command: str) -> int:
    """Run a tool of the environment and return its exit code."""
    print(f"== {title}", flush=True)
    return subprocess.run([sys.executable, "-m", *command], cwd=WORKSPACE).returncode


def main() -> int:
    """Run what was asked for; the exit code is the first that is not 0."""
    arguments = sys.argv[1:]
    if arguments[:1] in (["-h"], ["--help"]):
        print(__doc__)
        return 0
    codes = []
    if "--lint" in arguments:
        arguments.remove("--lint")
        codes.append(run("ruff check", "ruff", "check", "."))
        codes.append(run("ruff format", "ruff", "format", "--check", "."))
        codes.append(run("mypy", "mypy"))
    codes.append(run("pytest", "pytest", *arguments))
    return next((code for code in codes if code), 0)


if __name__ == "__main__":
    sys.exit(main())
