"""Processes of a weld that was started with a folder of its own."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def processes(folder: Path, *words: str) -> list[int]:
    """Processes whose parameters or logs are in a folder, with these words in their command line."""
    pids = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            line = (entry / "cmdline").read_bytes().decode(errors="replace")
        except OSError:
            continue
        if all(word in line for word in (str(folder), *words)):
            pids.append(int(entry.name))
    return pids


def kill(folder: Path, *modules: str) -> int:
    """Kill all processes of these modules at once; returns how many."""
    running = [process for module in modules for process in processes(folder, module)]
    for running_process in running:
        os.kill(running_process, signal.SIGKILL)
    return len(running)
