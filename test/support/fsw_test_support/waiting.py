"""Waits for conditions, never for times."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

#: For what comes within seconds on an idle machine; the start of a process takes a minute on one with twenty to run.
PATIENCE_S = 240.0


def wait_until(condition: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> None:
    """Wait until a condition holds; AssertionError when it takes too long."""
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, f"waited {timeout_s:g} s in vain for {what}"
        time.sleep(0.01)
