"""What heats a canister.

A constant power along a scenario's path, or what the bag of a weld has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fsw.bags import read_weld
from fsw.errors import CommandError
from fsw_analysis.phase_kpi import Span, recorded_spans
from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_heat import ReducedCanister
from fsw_heat.heat_model import CanisterState
from fsw_heat.history import ToolCourse
from fsw_heat.reduced import heated
from fsw_model import STEP_S, nominal
from fsw_plant import PlantConfig
from fsw_plant.canister import CanisterParameters
from fsw_plant.tool_path import ToolPath
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, parse
from fsw_scenario.weld_programme import MM_PER_DEG, spans

#: what is said of the angle is held until the next report, each second; a longer pause is a hold
_REPORT_S = 1.0


@dataclass(frozen=True, slots=True)
class CanisterWeld:
    """A weld whose heat is computed."""

    name: str
    parameters: CanisterParameters
    phases: Sequence[Span]
    course: ToolCourse
    #: power [kW] by which the canister is heated before the weld, and the stir zone's temperature
    #: then; None: cold
    heated: tuple[float, float] | None = None
    stir_zone_c: FloatArray | None = (
        None  #: the stir zone's temperature as recorded, for comparison
    )

    def start(self, canister: ReducedCanister) -> CanisterState:
        """The canister before the first step."""
        motion = float(self.course.traverse_mm_per_s[0]), float(self.course.axial_mm[0])
        if self.heated is None:
            return canister.initial(axial_mm=motion[1])
        power_kw, until_c = self.heated
        return heated(
            canister,
            power_kw,
            motion,
            STEP_S,
            lambda at: until_c - canister.stir_zone_temperature_c(at),
        )


def programmed(scenario_name: str, canister: Path | None, power_kw: float | None) -> CanisterWeld:
    """A constant power along the path of a scenario, from a cold canister."""
    scenario = load(scenario_name)
    config = PlantConfig.from_values(scenario.plant)
    parameters = (
        CanisterParameters.from_file(canister) if canister is not None else config.canister
    )
    if parameters is None:
        raise CommandError(f"scenario {scenario.name} has no process: canister; give another one")
    steps = round(scenario.duration_s / STEP_S)
    kw = nominal().operating_power_kw if power_kw is None else power_kw
    phases = spans(scenario.phases) if scenario.phases else [("weld", 0.0, scenario.duration_s)]
    speed, axial = _motion(
        ToolPath.of(scenario.path, config), np.arange(steps, dtype=np.float64) * STEP_S
    )
    return CanisterWeld(
        f"{scenario.name}, {kw:.3g} kW from cold",
        parameters,
        phases,
        ToolCourse(np.full(steps, kw), speed, axial),
    )


def recorded(bag: Path) -> CanisterWeld:
    """The power, the path and the canister of a bag."""
    signals = read_weld(bag)
    text = signals.attachments.get("scenario.yaml")
    scenario = parse(text.decode("utf-8", "replace"), "scenario.yaml of the bag") if text else None
    config = PlantConfig.from_values(scenario.plant) if scenario else None
    if scenario is None or config is None or config.canister is None:
        raise CommandError(
            f"{bag}: not of a weld on a plant with process: canister; "
            "leave the bag out for --power"
        )
    truth = signals.truth
    known = truth is not None and np.isfinite(truth.process_power_kw) & np.isfinite(
        truth.copper_temperature_c
    )
    if truth is None or np.count_nonzero(known) < 2:
        raise CommandError(f"{bag}: has no /fsw/plant/truth, which has the power")
    time_s = np.arange(signals.time_s[known][0], signals.time_s[known][-1] + 0.5 * STEP_S, STEP_S)
    power_kw, stir_zone_c = (
        np.interp(time_s, signals.time_s[known], values[known])
        for values in (truth.process_power_kw, truth.copper_temperature_c)
    )
    speed, axial = _motion_of(signals, scenario, config, time_s)
    phases = recorded_spans(signals) or [("weld", 0.0, float(time_s[-1]))]
    return CanisterWeld(
        f"{scenario.name}, power of the bag",
        config.canister,
        phases,
        ToolCourse(np.maximum(0.5 * (power_kw[1:] + power_kw[:-1]), 0.0), speed, axial),
        (config["start.power_kw"], float(stir_zone_c[0])),
        stir_zone_c[1:],
    )


def _motion(path: ToolPath, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speed and height in the steps that begin at times."""
    motions = [path.motion(at_s) for at_s in time_s.tolist()]
    return np.array([motion.traverse_mm_per_s for motion in motions]), np.array(
        [motion.axial_mm for motion in motions]
    )


def _motion_of(
    signals: WeldSignals, scenario: Scenario, config: PlantConfig, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Speed and height between the times.

    By the angle where a programme was played, for it may have been held.
    """
    known = np.flatnonzero(np.isfinite(signals.angle_deg))
    if not known.size:
        return _motion(
            ToolPath.of(scenario.path, config), time_s[:-1] - STEP_S
        )  # the first tick is at 0.1 s
    angle, at_s = signals.angle_deg[known], signals.time_s[known]
    new = np.flatnonzero(np.diff(angle, prepend=angle[0] - 1.0))
    points = {}
    for before, i in zip([new[0], *new[:-1]], new, strict=True):
        if at_s[i] - at_s[before] > 1.5 * _REPORT_S:  # it stood
            points[float(at_s[i]) - _REPORT_S] = float(angle[before])
        points[float(at_s[i])] = float(angle[i])
    arc = MM_PER_DEG * np.interp(time_s, list(points), list(points.values()))
    corners = [end for end in scenario.path if end.arc_mm > 0.0 or end is scenario.path[0]]
    axial = np.interp(arc, [end.arc_mm for end in corners], [end.axial_mm for end in corners])
    return np.diff(arc) / STEP_S, axial[1:]
