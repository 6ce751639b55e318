"""Memory of the actuator end (plant or gateway): the leader, and any safe stop in force.

The actuator end is the only place that every effective command passes. It therefore decides which
supervisor leads, and no other part has to agree on that: a fencing token ("term") in the sense of
Kleppmann, Designing Data-Intensive Applications, chapter 8, without any consensus protocol.
"""

from __future__ import annotations

from typing import NamedTuple

from fsw_control.coded import Fact, Worded
from fsw_control.contract import SAFE_STOP
from fsw_control.stop import Stop, StopCause, StopRegister

#: measurements within which a supervisor has to start a safe stop (chosen: 0.3 s)
_PATIENCE = 3
#: after this many lost commands in a row, control restarts from the drives' feedback; fewer are
#: made up for by the next command
LOST_COMMANDS = 3


class Barrier(Worded):
    """Reasons for which a command must not pass."""

    LEADER = "supervisor {leader} no longer leads: term {term}"
    STOPPED = "a safe stop is in force, and {source!r} is not part of it"
    UNAWARE = "{source!r} does not know the last acknowledgement yet"


class Signature(NamedTuple):
    """Signature of a supervisor's commands."""

    term: int = 0  #: number of its lead, greater than all terms before
    leader: str = ""  #: its identity
    stop: Stop = Stop()  #: its copy of the stop register


#: source while it is unknown whether the last command has reached the machine
UNKNOWN = "unknown"
#: a command that no supervisor has signed
UNSIGNED = Signature()


class ActuatorState(NamedTuple):
    """The actuator end's report with every measurement."""

    term: int = 0  #: greatest term of an accepted command
    leader: str = ""  #: sender of that command
    unanswered: int = 0  #: previous measurements in a row without an answer of this leader
    #: of the acting command: a controller, ``manual``, ``hold``, ``safe_stop`` or ``UNKNOWN``;
    #: empty before the first one, and while the actuator end itself moves the drives
    source: str = ""
    stop: Stop = Stop()  #: its copy of the stop register
    answered_ns: int = 0  #: stamp of the measurement that the acting command answers


class Fence:
    """Rejects commands of deposed supervisors, and all but ``safe_stop`` during a safe stop.

    Invariants, whatever arrives in whatever order: terms never fall; a term has one leader; the
    stop register never falls; while it is stopped, only commands of ``safe_stop`` pass; a command
    passes only if its sender knew the register's present epoch, or requests the safe stop.
    """

    def __init__(self) -> None:
        self.register = StopRegister()
        self._term, self._leader, self._source, self._answered_ns = 0, "", "", 0
        self._answered, self._unanswered, self._overdue = True, 0, 0
        # a safe stop of its own has begun since the last command that acts
        self._reacted = False

    @property
    def state(self) -> ActuatorState:
        """The report with the present measurement."""
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

        Two different stops of the same epoch were made without knowledge of each other. An
        acknowledgement of the first, made before the second, may be under way, so a new epoch
        begins, which it does not cover.
        """
        own = self.register.value
        self.register.merge(stop)
        if own.stopped and stop.stopped and stop.epoch == own.epoch and stop != own:
            latest = self.register.value
            self.register.stop(latest.cause, latest.who, latest.since_ns)

    def check(self, signature: Signature, source: str) -> Fact | None:
        """Return why a command must not pass, None if it may.

        Its copy of the stop register is merged in any case.
        """
        self.hear(signature.stop)
        same = signature.term == self._term and signature.leader == self._leader
        if not same and signature.term <= self._term:
            leader = signature.leader or "unknown"
            return Fact.of(Barrier.LEADER, leader=leader, term=signature.term)
        self._term, self._leader, self._answered = signature.term, signature.leader, True
        if source != SAFE_STOP and self.register.stopped:
            return Fact.of(Barrier.STOPPED, source=source)
        if source != SAFE_STOP and signature.stop < self.register.value:
            return Fact.of(Barrier.UNAWARE, source=source)
        return None

    def take(self, source: str, stamp_ns: int) -> None:
        """Note that ``source``'s command that answers the measurement of ``stamp_ns`` now acts."""
        self._source, self._answered_ns, self._reacted = source, stamp_ns, False

    def doubt(self) -> None:
        """Note that it is unknown whether the last command acts."""
        self._source = self._source and UNKNOWN

    @property
    def overdue(self) -> bool:
        """Whether no supervisor has started the safe stop in force for some measurements."""
        return self._waits and self._overdue > _PATIENCE

    @property
    def _waits(self) -> bool:
        return self.register.stopped and self._source != SAFE_STOP

    def stop(self, cause: StopCause, since_ns: int) -> None:
        """Begin a safe stop of the actuator end's own, once per loss of commands.

        It takes a new epoch even during a safe stop, so that an acknowledgement under way does
        not cover it.
        """
        if not (self.register.stopped and self._reacted):
            self.register.stop(cause, "plant", since_ns)
        self._source, self._reacted = "", True
