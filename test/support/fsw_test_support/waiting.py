"""Waits for conditions, never for times."""

from __future__ import annotations

import os
import re
import selectors
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fsw_scenario.launcher import Launcher

#: For what comes within seconds on an idle machine; the start of a process takes a minute on one
#: with twenty to run.
PATIENCE_S = 240.0


def wait_until(condition: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> None:
    """Wait until a condition holds; AssertionError when it takes too long."""
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, f"waited {timeout_s:g} s in vain for {what}"
        time.sleep(0.01)


def has_ended(pid: int, timeout_s: float = PATIENCE_S) -> bool:
    """Whether a process, also one that is no child of this one, ends within a time."""
    try:
        process = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        with selectors.DefaultSelector() as selector:
            selector.register(process, selectors.EVENT_READ)
            return bool(selector.select(timeout_s))
    finally:
        os.close(process)


def wait_for_text(
    launcher: Launcher, name: str, pattern: str, timeout_s: float = PATIENCE_S
) -> str:
    """Wait until a process has printed something that matches; returns what matched."""
    lines: list[str] = []

    def printed() -> bool:
        match = re.search(pattern, launcher.children[name].text())
        lines.extend([match[0]] if match else [])
        return bool(lines)

    launcher.wait_until(printed, timeout_s, f"{name} to print {pattern!r}")
    return lines[0]
