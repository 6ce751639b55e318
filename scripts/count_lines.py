#!/usr/bin/env python3
"""Counts the lines of code of each package (py, c, h; without tests), now and at another revision.

usage: count_lines.py [REVISION]
"""

import subprocess
import sys
from collections import Counter
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parents[1]
PATTERNS = [f"{folder}/*.{suffix}" for folder in ("src", "studies") for suffix in ("py", "c", "h")]


def lines(revision: str) -> Counter[str]:
    """Lines by package at a revision; those of the working tree if it is empty. Git itself tells its errors."""
    command = ["git", "grep", "-c", "", *([revision] if revision else []), "--", *PATTERNS]
    listed = subprocess.run(command, cwd=WORKSPACE, stdout=subprocess.PIPE, check=True, text=True).stdout
    found: Counter[str] = Counter()
    for line in listed.splitlines():
        name, _, count = line.removeprefix(f"{revision}:").rpartition(":")
        parts = name.split("/")
        if "test" not in parts[:-1]:
            found["/".join(parts[:2])] += int(count)
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
    then_sum = f"{sum(before.values()):>8}" if before else ""
    print(f"{'src and studies':<28}{sum(now.values()):>6}{then_sum}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
