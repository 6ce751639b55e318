"""Stamps of the ticks from the server's source timestamps."""

from __future__ import annotations

#: deviation of the source timestamps from counter and local clock that counts as a clock step of
#: the server [ns]
STEP_NS = 500_000_000


class Stamps:
    """Stamps that increase with the machine's cycles, independent of steps of its clock.

    A stamp is the counter's source timestamp plus a shift. The shift is 0 at first, or with
    ``received`` makes the first stamp the local time. If the source timestamps deviate by half a
    second both from the counted cycles and from the local time, or do not increase, the server's
    clock was set: the shift absorbs the step, and the stamps continue without it. Smaller
    deviations come from a busy machine or network.
    """

    def __init__(self, period_ns: int, received: bool = False) -> None:
        self.steps = 0  #: clock steps of the server
        self.shift_ns = 0  #: stamp less source timestamp
        self._period_ns, self._received = period_ns, received
        self._last_ns: int | None = None

    def next(self, source_ns: int, steps: int, local_ns: int, elapsed_ns: int) -> int:
        """Return the stamp of a tick from the counter's source timestamp.

        ``steps`` and ``elapsed_ns`` are the cycles (0: unknown) and the local steady time since
        the previous tick; ``local_ns`` is the local wall clock.
        """
        if self._last_ns is None:
            self.shift_ns = local_ns - source_ns if self._received else 0
        else:
            moved_ns = source_ns + self.shift_ns - self._last_ns
            counted_ns = steps * self._period_ns
            passed_ns = max(elapsed_ns, self._period_ns)
            off_ns = min(abs(moved_ns - (counted_ns or passed_ns)), abs(moved_ns - passed_ns))
            if off_ns > STEP_NS or moved_ns <= 0:
                self.steps += 1
                self.shift_ns += (counted_ns or passed_ns) - moved_ns
        self._last_ns = source_ns + self.shift_ns
        return self._last_ns
