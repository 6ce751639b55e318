"""What identification finds on a weld in heat, early and late, at the lid and the joint line; steps; needed power."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fsw_analysis.changes import part
from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_canister import CanisterParameters, ReducedCanister
from fsw_control.weld import TICK_S
from fsw_identification.estimation import identify
from fsw_identification.weld_data import prepare
from fsw_model import nominal
from fsw_plant import PlantConfig
from fsw_plant.process import reduced
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make_all, name_of
from fsw_scenario.scenario import Scenario
from fsw_scenario.weld_programme import spans

#: of the thermal part of (16)
THERMAL = ("thermal_gain_c_per_kw", "copper_lag_s", "tool_lag_s", "dead_time_s")
#: height above the joint line and time from the start of the experiments
PLACES = {"lid": 74.35, "joint line": 0.0}
TIMES_S = {"early": 180.0, "late": 2100.0}
#: time constant of the drives, as ``fsw.py identify`` assumes
_DRIVE_LAG_S = 0.02
_FITTED_S, _LONGEST_S = (60.0, 120.0, 300.0), 600.0
STEP_TIMES_S = (5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0)
_SPEED_MM_PER_S = 86.0 / 60.0
_CONTROLLER = "decentral:tight"
_TRAVERSED = "canister_weld_heat"


def run(scenario: Scenario, controller: str) -> WeldSignals:
    """A weld offline."""
    return ClosedLoop(scenario, make_all(scenario, controller, {})).run()


def experiment(axial_mm: float, begin_s: float) -> Scenario:
    """The shipped experiment for identification after so much welding, on the canister of the whole weld."""
    content = scenario_file.content_of(scenario_file.text_of("identify_closed_loop"))
    whole = scenario_file.content_of(scenario_file.text_of(_TRAVERSED))
    duration_s = begin_s + content["duration_s"]
    path = [
        {"at_s": at_s, "arc_mm": at_s * _SPEED_MM_PER_S, "axial_mm": axial_mm} for at_s in (0.0, round(duration_s, 1))
    ]
    events = [event | {"at_s": event["at_s"] + begin_s} for event in content["events"]]
    events.insert(0, {"at_s": 0.0, "reference": {"temperature_c": 816.4, "over_s": 25.0}})
    return scenario_file.read(
        content | {"plant": whole["plant"], "path": path, "events": events, "duration_s": duration_s}, "experiment"
    )


def identified(axial_mm: float, begin_s: float) -> dict[str, tuple[float, float]]:
    """Estimate and standard deviation of each thermal coefficient."""
    signals = run(experiment(axial_mm, begin_s), _CONTROLLER)
    window = part(signals, slice(round(begin_s / TICK_S), None))
    fit = identify(prepare(window, _DRIVE_LAG_S).segments, nominal())
    std = fit.std
    return {name: (float(getattr(fit.parameters, name)), std.get(name, 0.0)) for name in THERMAL}


def step_response(canister: ReducedCanister, axial_mm: float) -> FloatArray:
    """Rise of the stir zone by tick after a step of 1 kW, while the tool travels; after ten minutes of 43.6 kW."""
    base = canister.initial()
    power_kw, rises = nominal().operating_power_kw, []
    for _ in range(round(_LONGEST_S / TICK_S)):
        base = canister.step(base, power_kw, _SPEED_MM_PER_S, axial_mm, TICK_S)
    raised = base
    for _ in range(round(_LONGEST_S / TICK_S)):
        base = canister.step(base, power_kw, _SPEED_MM_PER_S, axial_mm, TICK_S)
        raised = canister.step(raised, power_kw + 1.0, _SPEED_MM_PER_S, axial_mm, TICK_S)
        rises.append(canister.stir_zone_temperature_c(raised) - canister.stir_zone_temperature_c(base))
    return np.array(rises)


def one_lag(rises: FloatArray, within_s: float) -> tuple[float, float]:
    """Gain [degC/kW] and lag [s] of the single lag that fits a step response best within a time."""
    from scipy.optimize import curve_fit

    seen = rises[: round(within_s / TICK_S)]
    time_s = TICK_S * np.arange(1, seen.size + 1)
    found, _ = curve_fit(lambda t, gain, lag: gain * (1.0 - np.exp(-t / lag)), time_s, seen, p0=(16.0, 25.0))
    return float(found[0]), float(found[1])


def steps() -> dict[str, dict[str, Any]]:
    """Step responses at some times, and the lags that fit them, of canisters and of (16) without dead time and tool."""
    p = nominal()
    time_s = TICK_S * np.arange(1, round(_LONGEST_S / TICK_S) + 1)
    courses = {"paper (16)": p.thermal_gain_c_per_kw * (1.0 - np.exp(-time_s / p.copper_lag_s))}
    own = PlantConfig.from_values(scenario_file.load(_TRAVERSED).plant).canister
    assert own is not None
    shapes = {"": own, ", default canister": CanisterParameters()}
    for words, parameters in shapes.items():
        courses |= {f"{place}{words}": step_response(reduced(parameters), z) for place, z in PLACES.items()}
    return {
        name: {
            "rise_c": {f"{t:g}": float(course[round(t / TICK_S) - 1]) for t in STEP_TIMES_S},
            "lags": {f"{t:g}": one_lag(course, t) for t in _FITTED_S},
        }
        for name, course in courses.items()
    }


def whole_weld(controller: str) -> dict[str, Any]:
    """The whole weld: mean power of each minute and of each phase, and how fast the spindle turns."""
    scenario = scenario_file.load(_TRAVERSED, [f"controller={name_of(controller)}"])
    signals = run(scenario, controller)
    assert signals.truth is not None
    power = signals.truth.process_power_kw
    phases = spans(scenario.phases, signals.n_ticks * TICK_S)
    return {
        "minutes_kw": [float(one.mean()) for one in np.array_split(power, range(600, power.size, 600))],
        "minutes_rpm": [float(one.mean()) for one in np.array_split(signals.speed_rpm, range(600, power.size, 600))],
        "phases_kw": {n: float(power[round(b / TICK_S) : round(e / TICK_S)].mean()) for n, b, e in phases},
        "phases_s": {name: [begin, end] for name, begin, end in phases},
    }


def validation(progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """All numbers of the page's first half."""
    found: dict[str, Any] = {"identified": {}, "steps": steps(), "weld": whole_weld(_CONTROLLER)}
    experiments = [(place, when) for place in PLACES for when in TIMES_S]
    for i, (place, when) in enumerate(experiments):
        found["identified"][f"{place}, {when}"] = identified(PLACES[place], TIMES_S[when])
        if progress is not None:
            progress((i + 1) / len(experiments))
    return found
