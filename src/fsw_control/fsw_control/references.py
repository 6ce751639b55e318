"""Which reference holds at a tick."""

from __future__ import annotations

from fsw_control.contract import Reference

NANOSECONDS = 1_000_000_000


class ReferenceQueue:
    """References in order of arrival, each held back until the time in its stamp.

    A sender that stamps a reference with the coming tick at which it shall begin gets exactly that tick, however
    fast the message travels; one that stamps it with 0 or a past time gets it at once. A stamp further ahead
    than ``horizon_s`` comes from another clock, and is taken as "now" too.

    Parameters
    ----------
    horizon_s : float
        Longest time that a reference may be sent ahead.
    """

    def __init__(self, horizon_s: float = 36_000.0) -> None:
        self._horizon_ns = round(horizon_s * NANOSECONDS)
        self._waiting: list[tuple[int, Reference]] = []
        self._current: Reference | None = None

    def add(self, stamp_ns: int, reference: Reference) -> None:
        """Take a reference that shall hold from ``stamp_ns`` on."""
        self._waiting.append((stamp_ns, reference))

    def at(self, tick_ns: int) -> Reference | None:
        """Return the reference that holds at a tick, None before the first.

        Ticks are asked for in order; a reference that has begun stays until the next begins.
        """
        if self._waiting:
            held: list[tuple[int, Reference]] = []
            for stamp_ns, reference in self._waiting:
                if tick_ns < stamp_ns <= tick_ns + self._horizon_ns:
                    held.append((stamp_ns, reference))
                else:
                    # A newer message overrides older ones still held back, else they would come back later.
                    held.clear()
                    self._current = reference
            self._waiting = held
        return self._current
