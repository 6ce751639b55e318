"""Processes of a weld that was started with a folder of its own."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def processes(folder: Path, *words: str) -> list[int]:
    """Processes whose parameters or logs are in a folder, with these words in their command line."""
    found = []
    for one in Path("/proc").glob("[0-9]*"):
        try:
            line = (one / "cmdline").read_bytes().decode(errors="replace")
        except OSError:
            continue
        if all(word in line for word in (str(folder), *words)):
            found.append(int(one.name))
    return found


def kill(folder: Path, *modules: str) -> int:
    """Kill all processes of these modules at once; returns how many."""
    found = [one for module in modules for one in processes(folder, module)]
    for one in found:
        os.kill(one, signal.SIGKILL)
    return len(found)
