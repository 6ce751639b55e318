"""Ages without the time in which this process itself stood still: only others' delays count."""

from __future__ import annotations

from collections import deque

#: looks come every 0.05 s; one that comes later by more than this was kept waiting (chosen)
_PERIOD_S, _LATE_S = 0.05, 0.05
#: delays that are remembered
_MOST = 1000
#: after delays of so much within so long no further one is excused: who is always late must not
#: hide that nothing comes (chosen)
_EXCUSED_S, _WITHIN_S = 2.0, 10.0


class Awake:
    """What came while the process stood still waits in its queues, so it is not missing yet.

    :meth:`look` is to be called at every look, on the clock of all other times.
    """

    def __init__(self) -> None:
        self._looked_s: float | None = None
        self._delays: deque[tuple[float, float]] = deque(maxlen=_MOST)  # end and length

    def look(self, now_s: float) -> None:
        """Note a look."""
        if self._looked_s is not None:
            late_s = now_s - self._looked_s - _PERIOD_S
            spent_s = sum(one_s for end_s, one_s in self._delays if now_s - end_s < _WITHIN_S)
            if late_s > _LATE_S and spent_s < _EXCUSED_S:
                self._delays.append((now_s, late_s))
        self._looked_s = now_s

    def age_s(self, came_s: float, now_s: float) -> float:
        """How long something that came at a time has been awaited since."""
        stood_s = sum(late_s for end_s, late_s in self._delays if end_s > came_s)
        return max(0.0, now_s - came_s - stood_s)
