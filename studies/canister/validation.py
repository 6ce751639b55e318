"""What identification finds on a weld in heat, early and late, at the lid and the joint line; steps; needed power."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import exp
from typing import Any

import numpy as np

from fsw_analysis.changes import part
from fsw_analysis.weld_signals import WeldSignals
from fsw_canister import CanisterParameters, ReducedCanister
from fsw_control.weld import TICK_S
from fsw_identification.estimation import identify
from fsw_identification.weld_data import prepare
from fsw_model import nominal
from fsw_plant.canister_process import reduced
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
STEP_TIMES_S = (5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0)
_SPEED_MM_PER_S = 86.0 / 60.0
_CONTROLLER = "decentral:tight"
_TRAVERSED = "canister_weld_heat"


def run(scenario: Scenario, controller: str) -> WeldSignals:
    """A weld offline."""
    return ClosedLoop(scenario, make_all(scenario, controller, {})).run()


def slow_steps() -> dict[str, Any]:
    """Steps of the temperature's set-point, far enough apart to show where they lead."""
    at_c = (822.4, 810.4, 816.4, 822.4, 816.4)
    events = [{"at_s": 5.0 + 120.0 * i, "reference": {"temperature_c": one}} for i, one in enumerate(at_c)]
    return {"name": "slow_steps", "controller": "decentral", "duration_s": 600.0, "events": events}


def experiment(content: dict[str, Any], axial_mm: float, begin_s: float) -> Scenario:
    """An experiment after so much welding, on the canister of the whole weld."""
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


def identified(content: dict[str, Any], axial_mm: float, begin_s: float) -> dict[str, tuple[float, float]]:
    """Estimate and standard deviation of each thermal coefficient."""
    signals = run(experiment(content, axial_mm, begin_s), _CONTROLLER)
    window = part(signals, slice(round(begin_s / TICK_S), None))
    fit = identify(prepare(window, _DRIVE_LAG_S).segments, nominal())
    std = fit.std
    return {name: (float(getattr(fit.parameters, name)), std.get(name, 0.0)) for name in THERMAL}


def step_response(canister: ReducedCanister, axial_mm: float) -> dict[float, float]:
    """Rise of the stir zone after a step of 1 kW, per kW, while the tool travels; about 43.6 kW for ten minutes."""
    base = canister.initial()
    power_kw, times = nominal().operating_power_kw, {round(at_s / TICK_S): at_s for at_s in STEP_TIMES_S}
    for _ in range(6000):
        base = canister.step(base, power_kw, _SPEED_MM_PER_S, axial_mm, TICK_S)
    raised, found = base, {}
    for tick in range(1, max(times) + 1):
        base = canister.step(base, power_kw, _SPEED_MM_PER_S, axial_mm, TICK_S)
        raised = canister.step(raised, power_kw + 1.0, _SPEED_MM_PER_S, axial_mm, TICK_S)
        if tick in times:
            rise_c = canister.stir_zone_temperature_c(raised) - canister.stir_zone_temperature_c(base)
            found[times[tick]] = rise_c
    return found


def steps() -> dict[str, dict[float, float]]:
    """Step responses of canisters, and of (16) without dead time and tool."""
    p = nominal()
    found = {
        "paper (16), copper alone": {
            t: p.thermal_gain_c_per_kw * (1.0 - exp(-t / p.copper_lag_s)) for t in STEP_TIMES_S
        }
    }
    for words, parameters in (
        ("with the lid's plate", CanisterParameters()),
        ("without", CanisterParameters(lid_mm=0.0)),
    ):
        for place, axial_mm in PLACES.items():
            found[f"{place}, {words}"] = step_response(reduced(parameters), axial_mm)
    return found


def needed_power(controller: str = _CONTROLLER) -> dict[str, Any]:
    """The whole weld: mean power of each minute, and of each phase."""
    scenario = scenario_file.load(_TRAVERSED, [f"controller={name_of(controller)}"])
    signals = run(scenario, controller)
    assert signals.truth is not None
    power = signals.truth.process_power_kw
    minutes = [float(one.mean()) for one in np.array_split(power, range(600, power.size, 600))]
    phases = spans(scenario.phases, signals.n_ticks * TICK_S)
    mean = {name: float(power[round(begin / TICK_S) : round(end / TICK_S)].mean()) for name, begin, end in phases}
    joint = next((begin, end) for name, begin, end in phases if name == "joint_line")
    return {"minutes_kw": minutes, "phases_kw": mean, "joint_line_s": joint, "signals": signals, "phases": phases}


def validation(progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """All numbers of the page's first half, but for the signals of the weld."""
    found: dict[str, Any] = {"identified": {}}
    experiments = [(place, when) for place in PLACES for when in TIMES_S]
    for i, (place, when) in enumerate(experiments):
        found["identified"][f"{place}, {when}"] = identified(PLACES[place], TIMES_S[when])
        if progress is not None:
            progress((i + 1) / (len(experiments) + 2))
    found["steps"] = {name: {str(t): rise for t, rise in one.items()} for name, one in steps().items()}
    power: Mapping[str, Any] = needed_power()
    found["power"] = {name: power[name] for name in ("minutes_kw", "phases_kw", "joint_line_s")}
    return found
