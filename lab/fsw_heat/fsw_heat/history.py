"""A weld's heat over its time: what the tool did goes in, temperatures come out."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fsw_heat.reduced import ReducedCanister
from fsw_plant.canister.copper import Array
from fsw_plant.canister.stepped import CanisterState

#: states kept of a weld, one a second, for pictures and thermocouples
KEEP_STEPS = 10
_PROGRESS_STEPS = 100


@dataclass(frozen=True, slots=True)
class ToolCourse:
    """What the tool does in each step of a weld, arrays of (steps,)."""

    power_kw: Array  #: power (24)
    traverse_mm_per_s: Array
    axial_mm: Array  #: above the joint line


@dataclass(frozen=True, slots=True)
class HeatHistory:
    """Heat of a weld; arrays of (steps,) at the ends of the steps."""

    canister: ReducedCanister
    time_s: Array
    stir_zone_c: Array  #: temperature of the stir zone
    angle_rad: Array  #: where the tool is around the canister
    course: ToolCourse
    kept_s: Array  #: times of the states
    states: list[CanisterState]

    def at(self, time_s: float) -> tuple[float, CanisterState]:
        """The kept state at a time or next after it, and its time; the last one after the end."""
        i = min(bisect_left(self.kept_s, time_s - 1e-6), len(self.states) - 1)
        return float(self.kept_s[i]), self.states[i]

    def thermocouples(self, places: Sequence[tuple[float, float, float]]) -> Array:
        """Temperatures at places (radius [mm], angle [rad], height above the joint line [mm]), (kept, places)."""
        r, angle, z = np.array(places, dtype=float).reshape(-1, 3).T
        return np.array([self.canister.temperature_c(state, r, angle, z) for state in self.states])


def heat_history(
    canister: ReducedCanister,
    start: CanisterState,
    course: ToolCourse,
    dt_s: float,
    progress: Callable[[float], None] | None = None,
) -> HeatHistory:
    """Heat a canister by a weld, in steps of ``dt_s``; ``progress`` is called with the share that is done.

    Raises
    ------
    fsw_control.schema.models.InputError
        If the tool is off the copper, or an input is not finite.
    """
    steps = course.power_kw.size
    state, states = start, [start]
    stir_zone, angle = np.empty(steps), np.empty(steps)
    inputs = zip(
        course.power_kw.tolist(),
        course.traverse_mm_per_s.tolist(),
        course.axial_mm.tolist(),
        strict=True,
    )
    for i, (power_kw, traverse, axial_mm) in enumerate(inputs):
        state = canister.step(state, power_kw, traverse, axial_mm, dt_s)
        stir_zone[i], angle[i] = canister.stir_zone_temperature_c(state), state.angle_rad
        if (i + 1) % KEEP_STEPS == 0 or i + 1 == steps:
            states.append(state)
        if progress is not None and i % _PROGRESS_STEPS == 0:
            progress(i / steps)
    time_s = np.arange(1, steps + 1, dtype=np.float64) * dt_s
    kept_s = np.append(dt_s * KEEP_STEPS * np.arange(len(states) - 1), time_s[-1])
    return HeatHistory(canister, time_s, stir_zone, angle, course, kept_s, states)
