"""One tick: a measurement, the candidate commands that answer it, and the one command that is decided."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isclose

from fsw_control.command_check import Flaw, refusal
from fsw_control.contract import Command, Limits


@dataclass(frozen=True, slots=True)
class ProposalInput:
    """A proposal as it came in.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the measurement that it answers.
    source : str
        Who claims to have computed it.
    command : Command
        The manipulated variables proposed.
    healthy, reason : bool, str
        The controller's own opinion, and why.
    """

    stamp_ns: int
    source: str
    command: Command
    healthy: bool = True
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A proposal that was checked."""

    command: Command
    refusal: str = ""  #: why it may not be applied, in words; empty when it may
    malformed: bool = False  #: refused for its content, not because the controller calls itself unhealthy
    jump: bool = False  #: refused for its distance from the command before


def check(name: str, proposal: ProposalInput, previous: Command | None, limits: Limits) -> Candidate:
    """Check a proposal on the topic of controller ``name``; without ``previous`` the rate is not checked."""
    command = proposal.command
    if proposal.source != name:
        words = f"proposal names the source {proposal.source[:40]!r} instead of {name!r}"
        return Candidate(command, words, malformed=True)
    if not proposal.healthy:
        return Candidate(command, proposal.reason or "the controller says it is unhealthy, without a reason")
    refused = refusal(command, limits, previous)
    if refused is not None:
        return Candidate(command, refused.words, malformed=True, jump=refused.flaw is Flaw.JUMP)
    return Candidate(command)


def same(one: Command, other: Command) -> bool:
    """Whether two commands differ by no more than the rounding of the unit conversion."""
    return isclose(one.force_kn, other.force_kn, rel_tol=1e-9) and isclose(one.speed_rpm, other.speed_rpm, rel_tol=1e-9)


@dataclass(frozen=True, slots=True)
class Decision:
    """The command of one tick.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the measurement that it answers.
    command : Command
        To be applied; finite, in limits, within one move limit of the one before.
    source : str
        Who computed it: a controller, ``manual``, ``hold`` or ``safe_stop``.
    reason : str
        Why this source; empty when nominal.
    latency_s : float
        Measurement to decision.
    """

    stamp_ns: int
    command: Command
    source: str
    reason: str = ""
    latency_s: float = 0.0


@dataclass(slots=True)
class Tick:
    """State of one tick; times are on the steady clock."""

    stamp_ns: int
    started_s: float
    deadline_s: float  #: when a command is decided with what is there
    before: Command | None  #: the command applied in the tick before; None: unknown
    samples: dict[str, float] = field(default_factory=dict)  #: by sensor [mm, N m, degC]
    drives: Command | None = None  #: force and speed that act, as the drives report them
    candidates: dict[str, Candidate] = field(default_factory=dict)  #: by controller, those that came in time
    ready: frozenset[str] = frozenset()  #: controllers that were ready when it began
    doubled: set[str] = field(default_factory=set)  #: controllers that proposed more than once
    conflicts: set[str] = field(default_factory=set)  #: controllers that proposed different commands
    judged: bool = False  #: the safety monitor has seen it
    absent: tuple[str, ...] = ()  #: sensors that have not come although they came in the tick before
    failure: str = ""  #: why the active controller has failed in this tick
    extended: bool = False  #: lockstep gives a slow fallback more time
    stalled: bool = False  #: the arbiter itself was held up, so that no controller counts as failed
    answered: bool = False  #: by the leader, while this supervisor stands by
    decided: bool = False  #: with a command or without one
    decision: Decision | None = None  #: the command, until it is sent
    excuse: str = ""  #: why no controller counts as failed, however it was decided; empty if one may

    @property
    def blameless(self) -> str:
        """Why a silent controller does not count as failed; empty if it does. Settled with the decision."""
        if self.decided:
            return self.excuse
        if self.stalled:
            return "the arbiter was held up"
        return "" if self.samples else "no sensor has come, only the drives' feedback"

    def decide(self, decision: Decision | None = None, excuse: str = "") -> None:
        """Settle the tick with a command, or without one."""
        self.excuse = excuse or self.blameless
        self.decided, self.decision = True, decision
