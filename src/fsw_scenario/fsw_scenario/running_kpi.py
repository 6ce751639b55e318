"""What is kept of a running weld: figures of merit, deviations from its scenario, times."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import isfinite

from fsw_control.coded import Fact
from fsw_control.contract import Reference
from fsw_control.weld import TICK_S
from fsw_scenario.weld_outcome import WeldEnd

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
