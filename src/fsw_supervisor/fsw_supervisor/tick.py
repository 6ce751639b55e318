"""One tick: a measurement, the proposals that answer it, and the one command."""

from __future__ import annotations

from dataclasses import dataclass, field

from fsw_control.contract import Command
from fsw_supervisor.checks import Verdict

NANOSECONDS = 1_000_000_000


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
