"""When the machine's cycle counter changes, and when to poll for the next change."""

from __future__ import annotations

from math import inf

#: polling begins this long before the expected change [s]
LEAD_S = 0.004
#: polling periods near the expected change, and when it is overdue [s]
NEAR_S = 0.002
OVERDUE_S = 0.01
#: number of periods after which the change is overdue
_OVERDUE_PERIODS = 1.5
#: share of the phase error that is corrected per change (a first-order phase-locked loop)
_GAIN = 0.2


class CycleTracker:
    """Tracks the counter, and the phase of its changes on the local steady clock.

    A server reports changes of a value only to subscribers, and itself chooses the sampling and
    publishing intervals. So the counter is polled, but only about when it is due.
    """

    def __init__(self, period_s: float) -> None:
        #: cycles that were never seen, and times that the counter went back
        self.skipped = self.restarts = 0
        #: number of values of the counter's type, after which it wraps around. A step by half of
        #: them or more counts as going back
        self.values = 1 << 64
        self._period_s = period_s
        self._counter: int | None = None
        self._due_s = -inf
        self._has_waited = False

    def see(self, counter: int, read_s: float) -> int | None:
        """Take a value of the counter, read at ``read_s`` on a steady clock.

        Returns
        -------
        int or None
            None if it has not changed; else the cycles since the previous value, 0 for the first
            value and if it has gone back.
        """
        before, self._counter = self._counter, counter
        if counter == before:
            self._has_waited = True
            return None
        steps = 0 if before is None else (counter - before) % self.values
        if 2 * steps >= self.values:
            steps = 0
        if before is not None and not steps:
            self.restarts += 1
        self.skipped += max(0, steps - 1)
        self._correct(steps, read_s)
        self._has_waited = False
        return steps

    def next_poll_s(self, read_s: float) -> float:
        """When to poll next, after a read at ``read_s``."""
        if read_s > self._due_s + (_OVERDUE_PERIODS - 1.0) * self._period_s:
            return read_s + OVERDUE_S
        return max(self._due_s - LEAD_S, read_s + NEAR_S)

    def _correct(self, steps: int, read_s: float) -> None:
        """Note when the next change is due."""
        if steps != 1 or abs(read_s - self._due_s) > self._period_s / 2.0:
            self._due_s = read_s + self._period_s
        elif self._has_waited:
            self._due_s += self._period_s + _GAIN * (read_s - self._due_s)
        else:
            # It had changed before the first poll, at an unknown time: poll earlier next time.
            self._due_s = min(self._due_s, read_s) + self._period_s - LEAD_S
