"""What the actuator end (plant or gateway) remembers: who leads, and whether a safe stop is in force.

The actuator end is the only place that every effective command passes. So it decides which
supervisor leads, and no other part has to agree on that.
"""

from __future__ import annotations

from typing import NamedTuple

from fsw_control.contract import SAFE_STOP
from fsw_control.stop import Stop, StopCause, StopRegister

#: measurements for which a supervisor has time to carry out a safe stop (chosen: 0.3 s)
_PATIENCE = 3
#: after this many commands in a row that do not reach the machine, control restarts from the
#: drives' feedback; single lost commands before are caught up with
LOST_COMMANDS = 3


class Signature(NamedTuple):
    """What a supervisor signs its commands with."""

    term: int = 0  #: number of its lead; greater than every term before
    leader: str = ""  #: its identity
    stop: Stop = Stop()  #: its copy of the stop register


#: source of what acts while it is not known whether the last command has reached the machine
UNKNOWN = "unknown"
#: a command that no supervisor has signed
UNSIGNED = Signature()


class ActuatorState(NamedTuple):
    """What the actuator end reports with every measurement."""

    term: int = 0  #: greatest term of a command that it has taken
    leader: str = ""  #: who sent that
    unanswered: int = 0  #: measurements in a row before this one that this leader has not answered
    #: of the command that acts: a controller, ``manual``, ``hold``, ``safe_stop`` or ``UNKNOWN``;
    #: empty before the first one, and while the actuator end moves the drives by itself
    source: str = ""
    stop: Stop = Stop()  #: its copy of the stop register
    answered_ns: int = 0  #: stamp of the measurement that the command which acts answers


class Fence:
    """Refuses commands of a supervisor that no longer leads, and all but safe-stop commands during a safe stop.

    Invariants, whatever arrives in whatever order: terms never fall; one term has one leader; the
    stop register never falls; while it says stopped, no command but one of ``safe_stop`` passes; a
    command passes only if its sender knew the register's present epoch, or asks for the safe stop.
    """

    def __init__(self) -> None:
        self.register = StopRegister()
        self._term, self._leader, self._source, self._answered_ns = 0, "", "", 0
        self._answered, self._unanswered, self._overdue = True, 0, 0
        self._reacted = (
            False  #: it has begun a safe stop of its own since the last command that acts
        )

    @property
    def state(self) -> ActuatorState:
        """What is reported with the present measurement."""
        value = self.register.value
        return ActuatorState(
            self._term, self._leader, self._unanswered, self._source, value, self._answered_ns
        )

    def measure(self) -> None:
        """Note that a new measurement is taken."""
        self._unanswered = 0 if self._answered else self._unanswered + 1
        self._answered = False
        self._overdue = self._overdue + 1 if self._waits else 0

    def hear(self, stop: Stop) -> None:
        """Merge another part's copy of the stop register.

        Two stops of one epoch were made without knowing each other. An acknowledgement of the
        first may be under way that was made before the second, so a new epoch begins, which it
        does not cover.
        """
        own = self.register.value
        self.register.merge(stop)
        if own.stopped and stop.stopped and stop.epoch == own.epoch and stop != own:
            latest = self.register.value
            self.register.stop(latest.cause, latest.who, latest.since_ns)

    def check(self, signature: Signature, source: str) -> tuple[str, str]:
        """Why a command may not pass: reason, of ``command_gate.REASONS``, and words; both empty if it may.

        Its copy of the stop register counts in any case.
        """
        self.hear(signature.stop)
        same = signature.term == self._term and signature.leader == self._leader
        if not same and signature.term <= self._term:
            return (
                "leader",
                f"supervisor {signature.leader or 'unknown'} no longer leads: term {signature.term}",
            )
        self._term, self._leader, self._answered = signature.term, signature.leader, True
        if source != SAFE_STOP and self.register.stopped:
            return "stopped", f"a safe stop is in force, and {source!r} is not part of it"
        if source != SAFE_STOP and signature.stop < self.register.value:
            return "stopped", f"{source!r} does not know the last acknowledgement yet"
        return "", ""

    def take(self, source: str, stamp_ns: int) -> None:
        """Note that a command of ``source``, which answers the measurement of a stamp, acts from now on."""
        self._source, self._answered_ns, self._reacted = source, stamp_ns, False

    def doubt(self) -> None:
        """Note that a command may act from now on, or not."""
        self._source = self._source and UNKNOWN

    @property
    def overdue(self) -> bool:
        """Whether a safe stop has been in force for some measurements, and no supervisor carries it out."""
        return self._waits and self._overdue > _PATIENCE

    @property
    def _waits(self) -> bool:
        return self.register.stopped and self._source != SAFE_STOP

    def stop(self, cause: StopCause, since_ns: int) -> None:
        """Begin a safe stop of the actuator end's own, once for each time that no commands come.

        It takes a new epoch during a safe stop, too: an acknowledgement under way does not cover
        it.
        """
        if not (self.register.stopped and self._reacted):
            self.register.stop(cause, "plant", since_ns)
        self._source, self._reacted = "", True
