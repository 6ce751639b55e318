"""One tick: a measurement, the candidate commands that answer it, and the decided command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isclose, nan
from typing import Any, NamedTuple

from fsw_control.command_gate import Flaw, refusal
from fsw_control.contract import Command, Limits
from fsw_control.reason import Reason, ReasonCode

#: after this time without measurements the command in force counts as unknown [s]
GAP_S = 1.0
_NOTHING: Mapping[str, Any] = {}  # shared, as nobody may write to a mapping of a tick


@dataclass(frozen=True, slots=True)
class ProposalInput:
    """A proposal as received."""

    stamp_ns: int  #: stamp of the measurement that it answers
    source: str  #: claimed origin of the values
    command: Command  #: the proposed inputs
    #: the controller's own assessment and reason
    healthy: bool = True
    reason: Reason = Reason()  # noqa: RUF009  # immutable


@dataclass(frozen=True, slots=True)
class Candidate:
    """A checked proposal."""

    command: Command
    refusal: Reason = Reason()  # noqa: RUF009  # why it must not be applied; empty if it may
    malformed: bool = False  #: refused for its content, not for the controller's own assessment
    jump: bool = False  #: refused for its distance from the command before


def check(
    name: str, proposal: ProposalInput, previous: Command | None, limits: Limits
) -> Candidate:
    """Check a proposal of controller ``name``; without ``previous`` the rate is not checked."""
    command = proposal.command
    if proposal.source != name:
        reason = Reason(ReasonCode.OTHER_SOURCE, subject=proposal.source[:40])
        return Candidate(command, reason, malformed=True)
    if not proposal.healthy:
        return Candidate(command, proposal.reason or Reason(ReasonCode.UNHEALTHY))
    refused = refusal(command, limits, previous)
    if refused is not None:
        jump = refused.flaw is Flaw.JUMP
        return Candidate(command, refused.reason, malformed=True, jump=jump)
    return Candidate(command)


def same(first: Command, other: Command) -> bool:
    """Whether two commands are equal up to the rounding of the unit conversion."""
    return all(map(isclose, first, other))  # by 1e-9 of the value


@dataclass(frozen=True, slots=True)
class Decision:
    """The command of one tick."""

    stamp_ns: int  #: stamp of the measurement that it answers
    command: Command  #: to apply; finite, within the limits, at most one move from the previous
    source: str  #: its origin: a controller, ``manual``, ``hold`` or ``safe_stop``
    reason: Reason = Reason()  # noqa: RUF009  # why this source, immutable
    latency_s: float = 0.0  #: time from measurement to decision


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a tick was settled."""

    #: the tick's command; None: lost, or answered by another supervisor
    decision: Decision | None
    #: why a silent controller does not count as failed; empty if it does
    excuse: Reason


class Tick(NamedTuple):
    """Inputs of one tick as far as they have arrived, and its outcome; times on the steady clock.

    Immutable: what changes a tick returns another one, and only
    :class:`fsw_supervisor.ticks.Ticks` decides which of them is present.
    """

    stamp_ns: int
    started_s: float
    deadline_s: float  #: when it is decided with the inputs at hand
    previous: Command | None  #: command applied in the tick before; None if unknown
    ready: frozenset[str] = frozenset()  #: controllers that were ready when it began
    samples: Mapping[str, float] = _NOTHING  #: by sensor [mm, N m, degC]
    depth_deviation_mm: float = nan  #: standard deviation of the depth; NaN if unknown
    drives: Command | None = None  #: actual force and speed, as reported by the drives
    #: by controller, proposals that arrived in time
    candidates: Mapping[str, Candidate] = _NOTHING
    #: by controller with several proposals: whether they differ
    duplicates: Mapping[str, bool] = _NOTHING
    judged: bool = False  #: by the safety monitor
    dropouts: tuple[str, ...] = ()  #: sensors without a sample that had one in the tick before
    #: why the active controller has failed in this tick
    failure: Reason = Reason()
    extended: bool = False  #: in lockstep: more time was given to a slow fallback
    drained: bool = False  #: after a stall of this process: time was given to drain its queues
    stalled: bool = False  #: this process was stalled, so that no controller counts as failed
    answered: bool = False  #: a command was sent, here or by the leader
    outcome: Outcome | None = None  #: None until it is settled

    @property
    def settled(self) -> bool:
        """Whether the tick has an outcome."""
        return self.outcome is not None

    @property
    def excuse(self) -> Reason:
        """Why a silent controller does not count as failed; empty if it does."""
        if self.outcome is not None:
            return self.outcome.excuse
        if self.stalled:
            return Reason(ReasonCode.STALLED)
        return Reason() if self.samples else Reason(ReasonCode.NO_SAMPLES)

    def settle(self, decision: Decision | None = None, excuse: Reason | None = None) -> Tick:
        """Return the tick settled with a command, or without one."""
        return self._replace(outcome=Outcome(decision, excuse or self.excuse))

    def with_candidate(self, name: str, candidate: Candidate) -> Tick:
        """Return the tick with the candidate command of a controller."""
        return self._replace(candidates={**self.candidates, name: candidate})
