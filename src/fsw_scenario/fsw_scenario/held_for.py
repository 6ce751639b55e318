"""Duration of a condition."""

from __future__ import annotations


class HeldFor:
    """Whether a condition has held for ``duration_s``, judged at the calls."""

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._since_s: float | None = None

    def __call__(self, condition: bool, now_s: float) -> bool:
        """Take the condition at the monotonic time ``now_s``; return whether it has held."""
        if not condition:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._duration_s
