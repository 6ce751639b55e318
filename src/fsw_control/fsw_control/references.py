"""Which set-points hold at a tick; the queue of those that were sent."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable
from typing import NamedTuple

from fsw_control.coded import Fact, Worded
from fsw_control.contract import Reference
from fsw_control.units import NANOSECONDS
from fsw_control.weld import TICK_NS

#: longest time that a reference may be sent ahead; later stamps come from another clock
OTHER_CLOCK_NS = 36_000 * NANOSECONDS
#: the same in real time, where the longest ramp takes 200 s
AHEAD_REAL_NS = 600 * NANOSECONDS
#: largest accepted deviation of a publication time from the receiver's clock
OWN_CLOCK_NS = 5 * NANOSECONDS


_REFUSED = "set-points {depth_mm:.4g} mm, {temperature_c:.5g} degC refused: "


class Refused(Worded):
    """Why set-points are refused, and what to do."""

    AHEAD = (
        _REFUSED + "they were published {ahead_s:.0f} s ahead of this computer's clock; "
        "set the sender's clock, or call fsw/set_reference"
    )
    OLD = (
        _REFUSED + "they were published {age_s:.0f} s ago by this computer's clock, "
        "and others are newer; "
        "send them again, set the sender's clock, or call fsw/set_reference"
    )
    TOO_FAR = (
        _REFUSED + "their stamp is {ahead_s:.0f} s ahead of the measurements, "
        "more than {limit_s:.0f} s: the time of another clock; "
        "send them with stamp 0 to apply them at once"
    )
    INVALID = "set-points refused: {why.words}; the message is in m and degC; those in force stay"
    BAD_ISSUE = "set-points on {topic} refused: the time of issue {issued_ns} ns is out of range"


class _Issued(NamedTuple):
    """A reference that waits for its time; the order is that of issue."""

    issued_ns: int
    values: tuple[float, float]  #: tie-break of equal places, independent of the receiving order
    number: int
    stamp_ns: int
    reference: Reference
    mark: str


class ReferenceQueue:
    """Set-points in order, each held back until the time in its stamp.

    The rules, for every node that follows set-points:

    - **Of all set-points whose time has come, the one received last is in force.** Earlier ones
      are void, including those sent ahead for later.
    - **The stamp says when it takes effect.** At exactly that tick if it is in the future, by at
      most ``horizon_ns``; at once if it is 0 or past. A later stamp is from another clock and is
      rejected.
    - **The publication time says whether it is old.** It is the sender's clock. If it is ahead of
      the receiver's by more than ``OWN_CLOCK_NS``, the set-point is rejected. If it lies before
      the receiver's start, or longer ago than that, it is a repetition by the middleware for late
      joiners, which arrives sender by sender in any order: the set-point is ordered by its
      publication time, and rejected if newer ones are, or will then be, in force.
    - **A standby orders by publication time alone** (``decides`` is False) and adopts the order of
      receipt of the nodes that are followed: set-points that reached only the standby, in the
      wrong order, must not be in force after a takeover.
    - **Every node that follows a set-point publishes it** with its place in the order; the latest
      place wins among nodes, so that all follow the same one, even if messages of two senders
      arrive in different order.

    Every rejection is reported, except of set-points published long before the receiver's start
    that arrive at its start. Publication times are on the computers' clocks in simulated time,
    too, so that the rules are the same there; stamps are on the clock of the measurements.

    Parameters
    ----------
    horizon_ns : int
        ``AHEAD_REAL_NS`` in real time; in simulated time a whole scenario may be sent ahead.
    refuse : callable, optional
        Gets a fact with a code of :class:`Refused`: what is rejected, and why.
    """

    def __init__(
        self, horizon_ns: int = OTHER_CLOCK_NS, refuse: Callable[[Fact], object] = lambda _: None
    ) -> None:
        #: place in the order of the reference in force: its publication time, or later if its
        #: predecessor's place requires it; 0 before the first one
        self.issued_ns = 0
        self.mark = ""  #: mark of the one in force
        self.refuse = refuse
        self.decides = True  #: False on a standby, which nobody follows
        self._horizon_ns = horizon_ns
        self._joined_ns: int | None = None
        self._tick_ns: int | None = None
        self._waiting: list[_Issued] = []
        self._current: Reference | None = None
        self._values = (0.0, 0.0)
        self._newest_ns = 0
        self._count = 0

    def __bool__(self) -> bool:
        """Whether any reference is known."""
        return self._current is not None or bool(self._waiting)

    @property
    def coming(self) -> bool:
        """Whether references are known that do not hold yet."""
        return bool(self._waiting)

    @property
    def n_waiting(self) -> int:
        """Number of known references that do not hold yet."""
        return len(self._waiting)

    def join(self, now_ns: int) -> None:
        """Note the receiver's start, on its computer's clock."""
        self._joined_ns = now_ns

    def receive(
        self, stamp_ns: int, reference: Reference, published_ns: int, now_ns: int, mark: str = ""
    ) -> bool:
        """Take a reference as sent; return whether it is accepted (rejections are reported).

        It holds from ``stamp_ns`` on, on the clock of the measurements (0: at once).
        ``published_ns`` is the sender's clock at publication, ``now_ns`` the receiver's at
        receipt; ``mark`` is kept with it.
        """
        if self._joined_ns is None or now_ns < self._joined_ns:
            # The first message marks the start; if the receiver's clock has gone back, the start
            # was long ago.
            self._joined_ns = now_ns if self._joined_ns is None else now_ns - OWN_CLOCK_NS - 1
        joined_ns, ahead_ns = self._joined_ns, published_ns - now_ns
        if ahead_ns > OWN_CLOCK_NS:
            return self._reject(Refused.AHEAD, reference, ahead_s=ahead_ns / NANOSECONDS)
        if self._tick_ns is not None and stamp_ns > self._tick_ns + self._horizon_ns:
            return self._reject_too_far(reference, stamp_ns, self._tick_ns)
        if self.decides and published_ns >= joined_ns + OWN_CLOCK_NS and ahead_ns >= -OWN_CLOCK_NS:
            self.add(stamp_ns, reference, max(published_ns, self._newest_ns + 1), mark)
            return True
        if not self._is_void(stamp_ns, reference, published_ns):
            self.add(stamp_ns, reference, published_ns, mark)
            return True
        # A repetition to a newly started receiver is normal, but otherwise it may come from a
        # clock that is slow.
        if self.decides and (ahead_ns >= -OWN_CLOCK_NS or now_ns > joined_ns + OWN_CLOCK_NS):
            self._reject(Refused.OLD, reference, age_s=-ahead_ns / NANOSECONDS)
        return False

    def add(
        self, stamp_ns: int, reference: Reference, issued_ns: int | None = None, mark: str = ""
    ) -> None:
        """Take a reference that holds from ``stamp_ns`` on (0: at once).

        ``issued_ns`` is its place in the order, by default after all known ones.
        """
        if issued_ns is None:
            issued_ns = self._newest_ns + 1
        self._newest_ns = max(self._newest_ns, issued_ns)
        values = (reference.depth_mm, reference.temperature_c)
        if (issued_ns, values) >= (self.issued_ns, self._values):
            self._count += 1
            known = [item.mark for item in self._waiting if item.issued_ns == issued_ns]
            mark = mark or "".join(known[:1]) or (self.mark if issued_ns == self.issued_ns else "")
            item = _Issued(issued_ns, values, self._count, stamp_ns, reference, mark)
            insort(self._waiting, item)

    def at(self, tick_ns: int) -> Reference | None:
        """Return the reference in force at a tick, None before the first; call it in order."""
        self._tick_ns = tick_ns
        for item in [item for item in self._waiting if item.stamp_ns > tick_ns + self._horizon_ns]:
            self._waiting.remove(item)
            self._reject_too_far(item.reference, item.stamp_ns, tick_ns)
        for index in range(len(self._waiting) - 1, -1, -1):
            item = self._waiting[index]
            if item.stamp_ns <= tick_ns:
                self._current, self._values = item.reference, item.values
                self.issued_ns, self.mark = item.issued_ns, item.mark
                del self._waiting[: index + 1]
                break
        return self._current

    def _is_void(self, stamp_ns: int, reference: Reference, issued_ns: int) -> bool:
        """Whether it would never hold, because a newer one holds or begins no later."""
        place = (issued_ns, (reference.depth_mm, reference.temperature_c))
        begins_ns = max(stamp_ns, 0 if self._tick_ns is None else self._tick_ns + TICK_NS)
        return place < (self.issued_ns, self._values) or any(
            place < (item.issued_ns, item.values) and item.stamp_ns <= begins_ns
            for item in self._waiting
        )

    def _reject_too_far(self, reference: Reference, stamp_ns: int, tick_ns: int) -> bool:
        ahead_s, limit_s = (stamp_ns - tick_ns) / NANOSECONDS, self._horizon_ns / NANOSECONDS
        return self._reject(Refused.TOO_FAR, reference, ahead_s=ahead_s, limit_s=limit_s)

    def _reject(self, code: Refused, reference: Reference, **data: float) -> bool:
        """Report a refusal; returns False."""
        self.refuse(Fact(code, {**values(reference), **data}))
        return False


def values(reference: Reference) -> dict[str, float]:
    """Set-points as fields of a fact."""
    return {"depth_mm": reference.depth_mm, "temperature_c": reference.temperature_c}
