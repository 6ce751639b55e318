#!/usr/bin/env python3
"""Counts the lines of code of each package (py, c, h; without tests), now and at another revision.

usage: count_lines.py [REVISION]
"""

import subprocess
import sys
from collections import Counter
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parents[1]
FOLDERS = ("src", "studies", "runtime")
SUFFIXES = (".py", ".c", ".h")


def git(*words: str) -> bytes:
    """Output of a git command; its error is shown by git itself."""
    return subprocess.run(["git", *words], cwd=WORKSPACE, stdout=subprocess.PIPE, check=True).stdout


def lines(revision: str) -> Counter[str]:
    """Lines by package at a revision; those of the working tree if it is empty."""
    listed = git("ls-tree", "-r", "--name-only", revision, *FOLDERS) if revision else git("ls-files", *FOLDERS)
    paths = [Path(one) for one in listed.decode().splitlines()]
    found: Counter[str] = Counter()
    for path in paths:
        if path.suffix in SUFFIXES and "test" not in path.parts[:-1]:
            content = git("show", f"{revision}:{path}") if revision else (WORKSPACE / path).read_bytes()
            found["/".join(path.parts[:2])] += content.count(b"\n")
    return found


def main() -> int:
    """Print a table."""
    if sys.argv[1:2] in (["-h"], ["--help"]):
        print(__doc__)
        return 0
    try:
        now, before = lines(""), lines(sys.argv[1]) if sys.argv[1:] else None
    except subprocess.CalledProcessError:
        return 2
    for package in sorted({*now, *(before or ())}):
        then = f"{before[package]:>8} {now[package] - before[package]:>+6}" if before else ""
        print(f"{package:<28}{now[package]:>6}{then}")
    inside = [name for name in now if not name.startswith("runtime")]
    then_sum = f"{sum(before[name] for name in before if not name.startswith('runtime')):>8}" if before else ""
    print(f"{'src and studies':<28}{sum(now[name] for name in inside):>6}{then_sum}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
