"""One tick: a measurement, the candidate commands that answer it, and the one command that is decided."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isclose

from fsw_control.command_check import Flaw, refusal
from fsw_control.contract import Command, Limits
from fsw_control.reason import Reason, ReasonCode

#: after this long without measurements the command in force counts as unknown [s]
GAP_S = 1.0


@dataclass(frozen=True, slots=True)
class ProposalInput:
    """A proposal as received."""

    stamp_ns: int  #: stamp of the measurement that it answers
    source: str  #: claimed origin of the values
    command: Command  #: the manipulated variables proposed
    #: the controller's own assessment, and its reason
    healthy: bool = True
    reason: Reason = Reason()  # noqa: RUF009  # immutable


@dataclass(frozen=True, slots=True)
class Candidate:
    """A checked proposal."""

    command: Command
    refusal: Reason = Reason()  # noqa: RUF009  # why it may not be applied; none when it may; immutable
    malformed: bool = (
        False  #: refused for its content, not because the controller calls itself unhealthy
    )
    jump: bool = False  #: refused for its distance from the command before


def check(
    name: str, proposal: ProposalInput, previous: Command | None, limits: Limits
) -> Candidate:
    """Check a proposal on the topic of controller ``name``; without ``previous`` the rate is not checked."""
    command = proposal.command
    if proposal.source != name:
        return Candidate(
            command, Reason(ReasonCode.OTHER_SOURCE, subject=proposal.source[:40]), malformed=True
        )
    if not proposal.healthy:
        return Candidate(command, proposal.reason or Reason(ReasonCode.UNHEALTHY))
    refused = refusal(command, limits, previous)
    if refused is not None:
        reason = Reason(ReasonCode.BAD_COMMAND, detail=refused.words)
        return Candidate(command, reason, malformed=True, jump=refused.flaw is Flaw.JUMP)
    return Candidate(command)


def same(one: Command, other: Command) -> bool:
    """Whether two commands differ by no more than the rounding of the unit conversion."""
    return isclose(one.force_kn, other.force_kn, rel_tol=1e-9) and isclose(
        one.speed_rpm, other.speed_rpm, rel_tol=1e-9
    )


@dataclass(frozen=True, slots=True)
class Decision:
    """The command of one tick."""

    stamp_ns: int  #: stamp of the measurement that it answers
    command: Command  #: to be applied; finite, in limits, within one move limit of the one before
    source: str  #: who computed it: a controller, ``manual``, ``hold`` or ``safe_stop``
    reason: Reason = Reason()  # noqa: RUF009  # why this source, immutable
    latency_s: float = 0.0  #: measurement to decision


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a tick was settled."""

    decision: (
        Decision | None
    )  #: the tick's command; None: it is lost, or another supervisor has answered it
    excuse: (
        Reason  #: why a controller that has not proposed does not count as failed; none if it does
    )


@dataclass(slots=True)
class Tick:
    """Inputs of one tick as they arrive, and its outcome; times are on the steady clock."""

    stamp_ns: int
    started_s: float
    deadline_s: float  #: when it is decided with the inputs that have arrived
    previous: Command | None  #: the command applied in the tick before; None: unknown
    ready: frozenset[str] = frozenset()  #: controllers that were ready when it began
    samples: dict[str, float] = field(default_factory=dict)  #: by sensor [mm, N m, degC]
    drives: Command | None = None  #: actual force and speed, as the drives report them
    candidates: dict[str, Candidate] = field(
        default_factory=dict
    )  #: by controller, those that arrived in time
    duplicates: dict[str, bool] = field(
        default_factory=dict
    )  #: by controller with several proposals: they differ
    judged: bool = False  #: by the safety monitor
    dropouts: tuple[str, ...] = ()  #: sensors without a sample that had one in the tick before
    failure: Reason = Reason()  # noqa: RUF009  #: why the active controller has failed in this tick
    extended: bool = False  #: lockstep gives a slow fallback more time
    drained: bool = False  #: this process was stalled, and its queues were given time to drain
    stalled: bool = False  #: this process was stalled, so that no controller counts as failed
    answered: bool = False  #: a command was sent, here or by the leader
    outcome: Outcome | None = None  #: None until it is settled

    @property
    def settled(self) -> bool:
        """Whether it has an outcome."""
        return self.outcome is not None

    @property
    def excuse(self) -> Reason:
        """Why a controller that has not proposed does not count as failed; none if it does."""
        if self.outcome is not None:
            return self.outcome.excuse
        if self.stalled:
            return Reason(ReasonCode.STALLED)
        return Reason() if self.samples else Reason(ReasonCode.NO_SAMPLES)

    def settle(self, decision: Decision | None = None, excuse: Reason | None = None) -> None:
        """Settle the tick with a command, or without one."""
        self.outcome = Outcome(decision, excuse or self.excuse)
