"""When the machine's cycle counter changes, and when to look for the next change."""

from __future__ import annotations

from math import inf

#: polling begins this long before the expected change [s]
LEAD_S = 0.004
#: time between two polls while the change is near, and while it is overdue [s]
NEAR_S = 0.002
OVERDUE_S = 0.01
#: number of periods after which the change counts as overdue
_OVERDUE_PERIODS = 1.5
#: share of the phase error that is corrected at a change
_GAIN = 0.2


class CycleTracker:
    """Follows the counter, and the phase of its changes on the local steady clock.

    A server reports changes of a value only to subscribers, and chooses the sampling and
    publishing intervals itself. So it is polled, but only about when the counter is due.
    """

    def __init__(self, period_s: float) -> None:
        self.skipped = self.restarts = (
            0  #: cycles that were never seen, and times that the counter went back
        )
        #: how many values the counter's type has: it begins again after the largest. A step by
        #: half of them or more counts as back
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
            None where it has not changed; else the cycles since the value before, 0 at the first
            value and where it has gone back.
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
        """When to read next, after the read of ``read_s``."""
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
            # It had changed before the first poll, at an unknown time: poll earlier.
            self._due_s = min(self._due_s, read_s) + self._period_s - LEAD_S
