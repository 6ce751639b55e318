"""A weld's heat over its time.

What the tool did goes in, temperatures and files of them come out.
"""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from fsw_heat.elements import Elements, elements_of, extra
from fsw_heat.heat_model import Array, CanisterState
from fsw_heat.reduced import ReducedCanister

#: states kept of a weld, one a second, for pictures and thermocouples
KEEP_STEPS = 10
_PROGRESS_STEPS = 100

#: points around the circumference to the shortest wave of the model
_POINTS_PER_WAVE = 3


def write_vtk(history: HeatHistory, times_s: Sequence[float], folder: Path) -> list[Path]:
    """Write a file for each moment into an existing folder, and one with their order in time.

    Returns their paths, ``canister.vtu.series`` first.
    """
    meshio = extra("meshio")
    canister = history.canister
    elements = elements_of(canister.parameters)
    angles = np.linspace(
        0.0, 2.0 * pi, _POINTS_PER_WAVE * canister.parameters.modes, endpoint=False
    )
    points, cells = _solid(elements, angles)
    r, z = 1e3 * elements.mesh.p
    files: list[tuple[Path, float]] = []
    for time_s in times_s:
        at_s, state = history.at(time_s)
        field = canister.temperature_c(state, r, angles[:, None], z).ravel()
        path = folder / f"canister_{at_s:06.0f}s.vtu"
        meshio.Mesh(points, cells, point_data={"temperature_c": field.astype(np.float32)}).write(
            path
        )
        files.append((path, at_s))
    series = folder / "canister.vtu.series"
    named = [{"name": path.name, "time": at_s} for path, at_s in files]
    series.write_text(
        json.dumps({"file-series-version": "1.0", "files": named}, indent=1) + "\n",
        encoding="utf-8",
    )
    return [series, *(path for path, _ in files)]


def _solid(elements: Elements, angles: Any) -> tuple[Any, list[tuple[str, Any]]]:
    """Points [mm] and cells of the section, swept around the axis, or along a plate."""
    section, (r, z) = elements.mesh.t, 1e3 * elements.mesh.p
    around = elements.mesh.p.shape[1]
    if elements.parameters.shape == "plate":
        x, y = np.broadcast_arrays(elements.parameters.outer_radius_mm * angles[:, None], r)
        here = np.arange(angles.size - 1)
    else:
        x, y = np.cos(angles)[:, None] * r, np.sin(angles)[:, None] * r
        here = np.arange(angles.size)
    points = np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1).reshape(-1, 3)
    there = (here + 1) % angles.size
    near, far = (section[None] + around * side[:, None, None] for side in (here, there))
    hexahedra = np.concatenate([near, far], axis=1).transpose(0, 2, 1).reshape(-1, 8)
    return points.astype(np.float32), [("hexahedron", hexahedra)]


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
        """Temperatures (kept, places) at radius [mm], angle [rad], height over the joint line."""
        r, angle, z = np.array(places, dtype=float).reshape(-1, 3).T
        return np.array([self.canister.temperature_c(state, r, angle, z) for state in self.states])


def heat_history(
    canister: ReducedCanister,
    start: CanisterState,
    course: ToolCourse,
    dt_s: float,
    progress: Callable[[float], None] | None = None,
) -> HeatHistory:
    """Heat a canister by a weld, in steps of ``dt_s``.

    ``progress`` is called with the share that is done.

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
