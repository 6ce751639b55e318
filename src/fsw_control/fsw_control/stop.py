"""The safe stop as a register: each part of a weld holds a copy, and merged copies converge.

The register is a state-based CRDT (a grow-only maximum; Shapiro et al. 2011): the merge is
commutative, associative and idempotent, so loss, delay, repetition and order do not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

from fsw_control.coded import Coded
from fsw_control.units import NANOSECONDS

#: largest epoch that a message can carry; it cannot be acknowledged, so that a stop always wins
LAST_EPOCH = 2**32 - 1
#: largest epoch that is a time [s]: the year 2065; later clocks leave epochs for what follows
_LAST_TIME = 3_000_000_000


class StopCause(Coded):
    """Cause of a safe stop, numbered as in ``Stop.msg``; one of a later version is none."""

    NONE = 0
    UNKNOWN = 0
    OPERATOR = 1, "requested"
    INTERLOCK = 2, "an interlock has tripped"
    HOLD_TIMEOUT = 3, "force and speed were held for too long"
    START_TIMEOUT = 4, "no controller was ready in time"
    BLIND = 5, "a sensor was invalid for too long"
    WATCHDOG = 6, "no commands reached the machine"
    RESTART = 7, "it began before a restart"
    CLOCK = 8, "stamps did not advance"


@dataclass(frozen=True, slots=True, order=True)
class Stop:
    """One value of the register.

    Values are ordered by epoch; at the same epoch a stop is greater than an acknowledgement. Each
    change takes a new epoch, so the greater of two values is either the one made with knowledge
    of the other, or the safer one.
    """

    #: 0: there has been no stop; else at least the time of the stop in seconds, increased by each
    #: change
    epoch: int = 0
    stopped: bool = False  #: in force; False: no stop yet, or the last one is acknowledged
    cause: StopCause = StopCause.NONE  #: of the last safe stop
    who: str = ""  #: made the change: an operator, an interlock, ``plant``
    since_ns: int = 0  #: stamp of the measurement at which it was made


class StopRegister:
    """A copy of the register, which only grows.

    Merging takes the maximum, so copies that have heard each other are equal, whatever was lost,
    delayed or repeated. A stop survives as long as one copy of it does. An acknowledgement from
    elsewhere cannot cover a stop of which no other copy has been heard: its maker did not know it.
    """

    def __init__(self) -> None:
        self.value = Stop()
        self._unheard = False  #: the value is a stop made here, and no other copy has shown it

    @property
    def stopped(self) -> bool:
        """Whether a safe stop is in force."""
        return self.value.stopped

    def merge(self, other: Stop) -> bool:
        """Take another copy's value; return whether this one has changed."""
        own, unheard = self.value, self._unheard
        self.value, self._unheard = max(own, other), unheard and other < own
        if unheard and other > own and not other.stopped:
            self.stop(own.cause, own.who, own.since_ns)
        return self.value != own

    def stop(self, cause: StopCause, who: str, since_ns: int) -> None:
        """Begin a safe stop, which the acknowledgement of an earlier one does not cover."""
        self.value = max(self.value, self.next_stop(cause, who, since_ns))
        self._unheard = True

    def next_stop(self, cause: StopCause, who: str, since_ns: int) -> Stop:
        """Return the value of a safe stop that would begin now.

        Its epoch is at least its time in seconds, so that an acknowledgement of an earlier weld,
        kept by a part that outlived the others, does not cover it.
        """
        epoch = max(self.value.epoch + 1, min(since_ns // NANOSECONDS, _LAST_TIME))
        return Stop(min(epoch, LAST_EPOCH), True, cause, who, since_ns)

    def acknowledge(self, who: str, since_ns: int) -> None:
        """End the safe stop that this copy knows."""
        if self.value.stopped and self.value.epoch < LAST_EPOCH:
            self.value = Stop(self.value.epoch + 1, False, self.value.cause, who, since_ns)
            self._unheard = False
