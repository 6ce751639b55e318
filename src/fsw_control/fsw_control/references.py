"""Which reference holds at a tick."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Sequence
from typing import NamedTuple

from fsw_control.contract import Coming, Reference
from fsw_control.units import NANOSECONDS

#: longest time that a reference may be sent ahead; a stamp further away comes from another clock
OTHER_CLOCK_NS = 36_000 * NANOSECONDS
#: most coming set-points that a controller is given
MOST_COMING = 8
#: longest tread of a stair by which a ramp or sine is announced
STAIR_S = 1.05


class _Issued(NamedTuple):
    """A reference that waits for its time; the order is that of issue."""

    issued_ns: int
    number: int
    stamp_ns: int
    reference: Reference


class ReferenceQueue:
    """References in the order in which they were issued, each held back until the time in its stamp.

    A reference stamped with a coming tick begins at exactly that tick, however fast the message travels; one stamped
    with 0 or a past time begins at once, and so does one stamped hours ahead, by another clock. At a tick, of all
    references that have begun the one issued last holds; whatever was issued before it is void, also what was sent
    ahead for later.

    The middleware repeats what it keeps to everyone who joins later, sender by sender. So the age of a message is not
    told by when it arrives but by when it was published.

    Attributes
    ----------
    issued_ns : int
        When the reference that holds was issued; 0 before the first.
    """

    def __init__(self) -> None:
        self.issued_ns = 0
        self._waiting: list[_Issued] = []
        self._current: Reference | None = None
        self._newest_ns = 0
        self._count = 0

    def __bool__(self) -> bool:
        """Whether any reference is known."""
        return self._current is not None or bool(self._waiting)

    def add(self, stamp_ns: int, reference: Reference, issued_ns: int | None = None) -> None:
        """Take a reference that holds from ``stamp_ns`` on (0: at once).

        ``issued_ns`` is when it was published, on the senders' clock; by default after all that is known.
        """
        if issued_ns is None:
            issued_ns = self._newest_ns + 1
        self._newest_ns = max(self._newest_ns, issued_ns)
        if issued_ns >= self.issued_ns:
            self._count += 1
            insort(self._waiting, _Issued(issued_ns, self._count, stamp_ns, reference))

    def at(self, tick_ns: int) -> Reference | None:
        """Return the reference that holds at a tick, None before the first; to be called in order of time."""
        for index in range(len(self._waiting) - 1, -1, -1):
            one = self._waiting[index]
            if not tick_ns < one.stamp_ns <= tick_ns + OTHER_CLOCK_NS:
                self._current, self.issued_ns = one.reference, one.issued_ns
                del self._waiting[: index + 1]
                break
        return self._current


class ReferencePlan:
    """Set-points that are known beforehand: in order, the time in ns from which each will hold, and the reference.

    A plan is believed only as long as it comes true: while the set-points in force are not those that it has for the
    present, because an operator has set others or the plan is of another weld, there are no coming ones.
    """

    def __init__(self, planned: Sequence[tuple[int, Reference]] = ()) -> None:
        self._stamps = [stamp_ns for stamp_ns, _ in planned]
        self._coming = [Coming(stamp_ns / NANOSECONDS, one.depth_mm, one.temperature_c) for stamp_ns, one in planned]

    def after(self, tick_ns: int, present: Reference) -> tuple[Coming, ...]:
        """The next ones after a tick at which ``present`` holds."""
        first = bisect_right(self._stamps, tick_ns)
        if first and not self._has_come(first - 1, present):
            return ()
        return tuple(self._coming[first : first + MOST_COMING])

    def _has_come(self, index: int, present: Reference) -> bool:
        """Whether ``present`` is what is planned, or near it while the plan is the stair of a ramp or sine."""
        planned = self._coming[index]
        near = [one for one in self._coming[max(index - 1, 0) : index + 2] if abs(one.at_s - planned.at_s) <= STAIR_S]
        return all(
            _within(getattr(present, name), [getattr(one, name) for one in near])
            for name in ("depth_mm", "temperature_c")
        )


def _within(value: float, planned: Sequence[float]) -> bool:
    """Whether a value lies among planned ones, or outside by no more than they differ."""
    low, high = min(planned), max(planned)
    slack = high - low + 1e-9
    return low - slack <= value <= high + slack
