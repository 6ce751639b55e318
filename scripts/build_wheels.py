#!/usr/bin/env python3
"""Builds all wheels, and the source distribution of fsw-control, into out/dist.

usage: build_wheels.py [--out FOLDER] [--host]

The libraries of fsw-control are compiled by zig, for x86-64 and AArch64 with glibc 2.17 or newer;
with --host for this machine alone, by its own compiler.
"""

import sys

from _bootstrap import WORKSPACE, ensure

if __name__ == "__main__":
    ensure(extras=("build",) if "--host" in sys.argv else ("build", "compiler"))

import argparse
import os
import subprocess
from pathlib import Path

PLATFORMS = ("manylinux_2_17_x86_64", "manylinux_2_17_aarch64")


def build(project: Path, out: Path, *kinds: str, platform: str = "") -> None:
    """Build distributions of a project; SystemExit with what was printed when that fails."""
    command = [
        sys.executable,
        "-m",
        "build",
        "--no-isolation",
        *kinds,
        "--outdir",
        str(out),
        str(project),
    ]
    environment = {**os.environ, **({"FSW_WHEEL_PLATFORM": platform} if platform else {})}
    made = subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    if made.returncode:
        sys.exit(f"{made.stdout}{project} {platform}: could not be built")


def main() -> int:
    """Build all; returns the exit code."""
    cli = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    cli.add_argument(
        "--out", type=Path, default=WORKSPACE / "out" / "dist", help="folder (default out/dist)"
    )
    cli.add_argument(
        "--host", action="store_true", help="for this machine alone, with its own C compiler"
    )
    arguments = cli.parse_args()
    build(WORKSPACE, arguments.out, "--sdist")
    for platform in ("",) if arguments.host else PLATFORMS:
        build(WORKSPACE, arguments.out, "--wheel", platform=platform)
    for name in ("quality", "lab"):
        build(WORKSPACE / name, arguments.out, "--wheel")
    for path in sorted(arguments.out.iterdir()):
        print(f"{path.stat().st_size / 1e3:8.0f} kB  {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
