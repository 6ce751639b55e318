"""Runs a function as a child process that ends with its parent, however that ends.

usage: python -m fsw_scenario.child_process <parent's pid> <module>.<function> [arguments]
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

from fsw_control.schema.entry import Program

_PR_SET_PDEATHSIG = 1


def end_with_parent(parent_pid: int) -> None:
    """Request SIGTERM from the kernel when the parent dies (Linux only)."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent_pid:
        sys.exit("the parent has ended already")


def main() -> int:
    """Run the function named on the command line; returns the exit code."""
    parent_pid, path, *arguments = sys.argv[1:]
    end_with_parent(int(parent_pid))
    sys.argv = [path.rpartition(".")[0], *arguments]
    return Program(path)()


if __name__ == "__main__":
    sys.exit(main())
