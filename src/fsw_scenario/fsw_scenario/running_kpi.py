"""What is kept of a running weld: figures of merit, deviations from its scenario, its end."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from fsw_control.coded import Fact, Worded
from fsw_control.contract import Reference
from fsw_control.weld import TICK_S

#: time for a requested controller, or its replacement, to be in control (chosen)
_SWITCH_TICKS = 20


class HeldFor:
    """Whether a condition has held for ``duration_s``, judged at the calls."""

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._since_s: float | None = None

    def __call__(self, condition: bool, now_s: float) -> bool:
        """Take the condition at the monotonic time ``now_s``; return whether it has held."""
        if not condition:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._duration_s


class Deviations:
    """Counts ticks under an unrequested controller and notes manual set-points."""

    def __init__(self) -> None:
        self._asked: tuple[int, str] | None = None
        self._others: Counter[str] = Counter()
        self._by_hand_tick: int | None = None

    def ask(self, controller: str, tick: int) -> None:
        """Note a controller requested at a tick."""
        self._asked = tick, controller

    def count(self, controller: str, tick: int, ticks: int) -> None:
        """Note the controller (empty: unknown) in control for some ticks up to this one."""
        if self._asked is None or controller in ("", self._asked[1]):
            return
        late = tick - self._asked[0] - _SWITCH_TICKS
        if late > 0:
            self._others[controller] += min(ticks, late)

    def note_by_hand(self, tick: int) -> None:
        """Note manual set-points in force from a tick on."""
        self._by_hand_tick = tick

    @property
    def others_s(self) -> dict[str, float]:
        """How long controllers that were not asked for were in control, by name."""
        return {name: ticks * TICK_S for name, ticks in self._others.items()}

    @property
    def by_hand_from_s(self) -> float | None:
        """Since when set-points by hand are in force."""
        return None if self._by_hand_tick is None else self._by_hand_tick * TICK_S

    @property
    def facts(self) -> tuple[Fact, ...]:
        """Both as facts."""
        facts = [
            Fact.of(WeldEnd.UNREQUESTED, controller=name, time_s=time_s)
            for name, time_s in self.others_s.items()
        ]
        if self.by_hand_from_s is not None:
            facts.append(Fact.of(WeldEnd.BY_HAND, time_s=self.by_hand_from_s))
        return tuple(facts)


@dataclass(slots=True)
class RunningKpi:
    """Integral [mm s, degC s] and maximum [mm, degC] of the absolute errors to the set-points."""

    depth_iae: float = 0.0
    temperature_iae: float = 0.0
    depth_max_error: float = 0.0
    temperature_max_error: float = 0.0

    def add(
        self, lasted_s: float, target: Reference, depth_mm: float, temperature_c: float
    ) -> None:
        """Take the readings at the end of an interval; values that are not finite are skipped."""
        for name, error in (
            ("depth", abs(depth_mm - target.depth_mm)),
            ("temperature", abs(temperature_c - target.temperature_c)),
        ):
            if isfinite(error):
                setattr(self, f"{name}_iae", getattr(self, f"{name}_iae") + lasted_s * error)
                setattr(self, f"{name}_max_error", max(getattr(self, f"{name}_max_error"), error))


FAILED, REFUSED = "failed", "refused"


class WeldEnd(Worded):
    """Why a weld ended, or never began, and what in it was not as its scenario has it."""

    OVER = "{scenario} is over after {time_s:g} s"
    CANCELLED = "cancelled; the supervisor is in safe_stop ({answer})"
    STOPPED = "safe stop by the supervisor: {why}"
    NO_CONTROLLER = "{absent}; start it, or name another one"
    SILENT = "{missing} for {time_s:g} s; is the graph running, on the same domain?"
    UNANSWERED = "its own goal is not answered for {time_s:g} s"
    OTHER_PLAYER = "another scenario player in the graph for {time_s:g} s"
    # beside them
    UNREQUESTED = "{controller} was in control for {time_s:.1f} s, not asked for"
    BY_HAND = "set-points by hand from {time_s:.1f} s on"
    # refused
    INVALID = "{error}"
    EMPTY = "scenario is empty; give a shipped one, a file, or YAML text"
    UNDER_WAY = "{scenario} is under way ({state}); abort it first"
    OTHER_SCENARIO = "this player has been started for {scenario}"
    TWO_PLAYERS = (
        "another scenario player would get the goal, too; end one, and send it again in 10 s"
    )
    BY_OPEN_LOOP = "{scenario} controls by hand: controllers and plant must be started with it"
    ON_CANISTER = (
        "{scenario} conducts heat in a canister: controllers and plant must be started with it"
    )
    NO_EMULATOR = (
        "{scenario} has disturbances or faults, which need the emulated plant, and none is found; "
        "where it has just been started, send the goal again in a second"
    )


class Outcome(NamedTuple):
    """End of a weld; ``verdict`` is ``done``, ``aborted``, ``failed``, or ``refused`` to begin."""

    verdict: str
    fact: Fact
    others: tuple[Fact, ...] = ()  #: deviations, or the state

    @property
    def words(self) -> str:
        """All of it in words."""
        return "; ".join(fact.words for fact in (self.fact, *self.others))
