"""One tick: a measurement, the candidate commands that answer it, and the one command."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import isclose

from fsw_control.command_check import Flaw, refusal
from fsw_control.contract import Command, Limits

NANOSECONDS = 1_000_000_000


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
        The proposed handles.
    healthy : bool
        The controller's own opinion.
    reason : str
        Its reason, in words.
    """

    stamp_ns: int
    source: str
    command: Command
    healthy: bool = True
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Outcome of the check; ``reason`` is empty when ``ok``.

    ``content`` tells a refusal for the content of the message from the controller's own unhealthy flag, ``jump`` one
    for the distance from the command before.
    """

    ok: bool
    command: Command
    reason: str = ""
    content: bool = False
    jump: bool = False


def check(name: str, proposal: ProposalInput, previous: Command | None, limits: Limits) -> Verdict:
    """Check one proposal.

    Parameters
    ----------
    name : str
        Name of the controller whose topic carried it.
    proposal : ProposalInput
        What it proposes.
    previous : Command or None
        Command applied in the tick before; None: unknown, the rate is not checked.
    limits : Limits
        Bounds and largest change per tick.

    Returns
    -------
    Verdict
        Good, or refused with the first reason found.
    """
    command = proposal.command
    if proposal.source != name:
        words = f"proposal names the source {proposal.source[:40]!r} instead of {name!r}"
        return Verdict(False, command, words, content=True)
    if not proposal.healthy:
        return Verdict(False, command, proposal.reason or "the controller says it is unhealthy, without a reason")
    refused = refusal(command, limits, previous, limits)
    if refused is not None:
        return Verdict(False, command, refused.words, content=True, jump=refused.flaw is Flaw.JUMP)
    return Verdict(True, command)


def same(one: Command, other: Command) -> bool:
    """Whether two commands differ by no more than the rounding of the unit conversion."""
    return isclose(one.force_kn, other.force_kn, rel_tol=1e-9) and isclose(one.speed_rpm, other.speed_rpm, rel_tol=1e-9)


@dataclass(slots=True)
class Tick:
    """State of one tick.

    Attributes
    ----------
    stamp_ns : int
        Stamp of its measurement.
    started_s, deadline_s : float
        On the steady clock: first sample of the stamp; when a command is decided anyway.
    before : Command or None
        Command applied in the tick before.
    samples : dict of str to float
        By sensor (mm, N m, degC).
    drives : Command or None
        What the drives say that acts on the process.
    verdicts : dict of str to Verdict
        By controller, of the proposals that came in time.
    doubled, conflicts : set of str
        Controllers from which more than one proposal came, and from which different ones came.
    evaluated : bool
        Whether sensors and interlocks have been judged.
    failed : bool
        Whether the active controller has failed in this tick.
    extended : bool
        Whether lockstep gives a slow fallback more time.
    stalled : bool
        Whether the arbiter itself was held up, so that nobody can be blamed.
    decided : bool
        Whether its command is out.
    answered : bool
        Off duty: whether the one on duty has sent its command.
    surprised : tuple of str
        Sensors that have not come although they came in the tick before.
    excuse : str
        Why nobody is blamed for the way it was decided; empty if somebody may be.
    """

    stamp_ns: int
    started_s: float
    deadline_s: float
    before: Command | None
    samples: dict[str, float] = field(default_factory=dict)
    drives: Command | None = None
    verdicts: dict[str, Verdict] = field(default_factory=dict)
    doubled: set[str] = field(default_factory=set)
    conflicts: set[str] = field(default_factory=set)
    evaluated: bool = False
    failed: bool = False
    extended: bool = False
    stalled: bool = False
    decided: bool = False
    answered: bool = False
    surprised: tuple[str, ...] = ()
    excuse: str = ""

    @property
    def blameless(self) -> str:
        """Why no controller can be blamed for not having answered; empty if it can. Settled with the decision."""
        if self.decided:
            return self.excuse
        if self.stalled:
            return "the arbiter was held up"
        return "" if self.samples else "no sensor has come, only the drives' feedback"

    def decide(self, excuse: str = "") -> None:
        """Note that its command is out, or that it goes without one."""
        self.excuse = excuse or self.blameless
        self.decided = True


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


#: for so long a foreign command is remembered [s]
_FOREIGN_S = 5.0


class CommandWatch:
    """What was sent, and what was seen that was not.

    Attributes
    ----------
    foreign_commands : int
        Commands of other writers seen.
    foreign_tick : int
        Number of the tick in which the last of them came.
    """

    def __init__(self) -> None:
        self.foreign_commands = 0
        self.foreign_tick = -10
        self._sent: deque[Decision] = deque(maxlen=50)
        self._foreign_s: float | None = None

    def sent(self, decision: Decision) -> None:
        """Note that a decision goes out."""
        self._sent.append(decision)

    def is_own(self, stamp_ns: int, source: str, command: Command) -> bool:
        """Whether a command seen was sent here; each counts once."""
        for decision in self._sent:
            if decision.stamp_ns == stamp_ns and decision.source == source and same(decision.command, command):
                self._sent.remove(decision)
                return True
        return False

    def note_foreign(self, now_s: float, tick: int) -> bool:
        """Note a foreign command; returns whether it is the first for a while."""
        first = not self.seen_lately(now_s)
        self.foreign_commands += 1
        self._foreign_s, self.foreign_tick = now_s, tick
        return first

    def seen_lately(self, now_s: float) -> bool:
        """Whether someone else has written commands lately."""
        return self._foreign_s is not None and now_s - self._foreign_s <= _FOREIGN_S
