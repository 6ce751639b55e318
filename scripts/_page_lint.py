"""Lint of the operator's page, ``test.py --lint``: its types by tsc, its habits by ESLint.

Both come by ``npm ci`` into a folder that is not tracked. npm is the system's or, where there is none that is new
enough, that of the wheel in ``requirements/node.lock``. Where they cannot be had, a line says so and the lint is
skipped: the page itself needs none of them.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from _bootstrap import WORKSPACE

PAGE = WORKSPACE / "src" / "fsw_hmi"
_NODE = (20, 19)  # what ESLint needs
_LOCK = WORKSPACE / "requirements" / "node.lock"


def lint() -> int:
    """Check the page's modules; the exit code of the first tool that complains."""
    print("== tsc and eslint of the operator's page", flush=True)
    npm = _npm()
    if npm is None:
        return _skip(f"there is no npm, and pip could not install {_LOCK.name}; install Node.js 20.19 or newer")
    # npm finds its node, and what it installs, beside itself
    environment = {**os.environ, "PATH": os.pathsep.join([str(npm.parent), os.environ.get("PATH", "")])}
    lock, installed = PAGE / "package-lock.json", PAGE / "node_modules" / "installed-lock.json"
    if not installed.exists() or installed.read_bytes() != lock.read_bytes():
        command = [str(npm), "ci", "--no-fund", "--no-audit", "--ignore-scripts"]
        made = subprocess.run(command, cwd=PAGE, env=environment, capture_output=True, text=True)
        if made.returncode:
            why = next((line for line in made.stderr.splitlines() if line.startswith("npm error")), "no reason given")
            return _skip(f"'npm ci' failed in {PAGE.name}, a registry must be reachable the first time: {why}")
        shutil.copyfile(lock, installed)
    return subprocess.run([str(npm), "run", "--silent", "lint"], cwd=PAGE, env=environment).returncode


def _npm() -> Path | None:
    own = Path(sys.prefix) / "bin" / "npm"
    for found in (shutil.which("npm"), own):
        if found and _version(Path(found).with_name("node")) >= _NODE:
            return Path(found)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q", "--only-binary", ":all:"]
    subprocess.run([*pip, "-r", str(_LOCK)])
    return own if own.exists() else None


def _version(node: Path) -> tuple[int, ...]:
    try:
        told = subprocess.run([node, "--version"], capture_output=True, text=True).stdout
    except OSError:
        return ()
    return tuple(map(int, re.findall(r"\d+", told)[:2]))


def _skip(why: str) -> int:
    print(f"SKIPPED, the page is not checked: {why}", flush=True)
    return 0
