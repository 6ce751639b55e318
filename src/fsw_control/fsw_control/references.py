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
        self._since_ns = 0
        self._first_tick_ns: int | None = None
        self._handed_on = False

    def add(self, stamp_ns: int, reference: Reference) -> None:
        """Take a reference that shall hold from ``stamp_ns`` on."""
        if not (self._handed_on and 0 < stamp_ns <= self._since_ns):
            self._waiting.append((stamp_ns, reference))

    def hand_on(self, since_ns: int, reference: Reference) -> None:
        """Take what another listener, who was here before, says to hold since ``since_ns``.

        It counts for who has nothing of his own, or only what was sent for times before that; not for who was here
        at that time himself.
        """
        own = self._current is not None and not self._handed_on
        here = self._first_tick_ns is not None and since_ns >= self._first_tick_ns
        if own and (here or self._since_ns > since_ns):
            return
        self._current, self._since_ns, self._handed_on = reference, since_ns, True
        self._waiting = [entry for entry in self._waiting if not 0 < entry[0] <= since_ns]

    def at(self, tick_ns: int) -> Reference | None:
        """Return the reference that holds at a tick, None before the first.

        Ticks are asked for in order; a reference that has begun stays until the next begins.
        """
        if self._first_tick_ns is None or tick_ns < self._first_tick_ns:
            self._first_tick_ns, self._since_ns = tick_ns, min(self._since_ns, tick_ns)
        if self._waiting:
            held: list[tuple[int, Reference]] = []
            for stamp_ns, reference in self._waiting:
                if tick_ns < stamp_ns <= tick_ns + self._horizon_ns:
                    held.append((stamp_ns, reference))
                else:
                    # A newer message overrides older ones still held back, else they would come back later.
                    held.clear()
                    self._current, self._handed_on = reference, False
                    self._since_ns = stamp_ns if 0 < stamp_ns < tick_ns else tick_ns
            self._waiting = held
        return self._current
