"""All that the study measures: identification in heat, steps, needed power, and the reductions.

:func:`validation` is the plant's, :func:`properties` the error of linear copper.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from canister.full import FullCanister, exact_stir_zone_c
from fsw_analysis.changes import part
from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.weld import TICK_S
from fsw_heat import load_or_compact, load_or_reduce
from fsw_heat.cache import projection_of
from fsw_heat.compaction import TOLERANCE_K, compact_of
from fsw_heat.heat_model import CanisterState, CompactCanister, HeatModel
from fsw_heat.history import ToolCourse
from fsw_heat.reduced import heated
from fsw_identification.estimation import identify
from fsw_identification.weld_data import prepare
from fsw_model import nominal
from fsw_plant import PlantConfig
from fsw_plant.canister import CanisterParameters
from fsw_plant.tool_path import ToolPath
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
#: time after a step to which the single lag is fitted, and for which the step is followed
_FITTED_S, _LONGEST_S = 120.0, 600.0
STEP_TIMES_S = (5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0)
_SPEED_MM_PER_S = 86.0 / 60.0
_CONTROLLER = "decentral:tight"
_TRAVERSED, _EXPERIMENT = "canister_weld_heat", "identify_heat"
#: ticks for which power, speed and height are held in the comparison with all finite elements
_HELD_TICKS = 5
#: elements and modes of the campaign
COARSE = ("plant.canister.element_mm=12.0", "plant.canister.modes=64")
#: of the plant's model: tolerances, traverse speeds and time for which it is put beside the
#: decoupled one
_TOLERANCES_K, _TRAVERSES_MM_PER_MIN, _COMPARED_S = (
    (0.2, 0.1, TOLERANCE_K, 0.01),
    (0.0, 43.0, 86.0, 172.0),
    1200,
)
#: constant power [kW] and length of a step [s]
POWER_KW, _STEP_S = 47.0, 4.0
#: mesh and modes for the copper as it is: all three models have the same
_COARSE = {"element_mm": 12.0, "modes": 64}
#: models of the copper, by the name in the results
MODELS = {
    "real": ("kirchhoff", True),
    "kirchhoff": ("kirchhoff", False),
    "constant": ("constant", False),
}


def run(scenario: Scenario, controller: str) -> WeldSignals:
    """A weld offline."""
    return ClosedLoop(scenario, make_all(scenario, controller, {})).run()


def experiment(axial_mm: float, begin_s: float) -> Scenario:
    """The shipped experiment for heat after so much welding, at a height above the joint line."""
    content = scenario_file.content_of(scenario_file.text_of(_EXPERIMENT))
    duration_s = begin_s + content["duration_s"]
    path = [
        {"at_s": at_s, "arc_mm": at_s * _SPEED_MM_PER_S, "axial_mm": axial_mm}
        for at_s in (0.0, round(duration_s, 1))
    ]
    events = [event | {"at_s": event["at_s"] + begin_s} for event in content["events"]]
    events.insert(0, {"at_s": 0.0, "reference": {"temperature_c": 816.4, "over_s": 25.0}})
    return scenario_file.read(
        content | {"path": path, "events": events, "duration_s": duration_s}, "experiment"
    )


def identified(axial_mm: float, begin_s: float) -> dict[str, dict[str, tuple[float, float]]]:
    """Estimate and deviation of each thermal coefficient, without and with drifts."""
    signals = run(experiment(axial_mm, begin_s), _CONTROLLER)
    segments = prepare(part(signals, slice(round(begin_s / TICK_S), None)), _DRIVE_LAG_S).segments
    estimates = {}
    for words, steady in (("steady", True), ("drifts", False)):
        fit = identify(segments, nominal(), steady=steady)
        std = fit.std
        estimates[words] = {
            name: (float(getattr(fit.parameters, name)), std.get(name, 0.0)) for name in THERMAL
        }
    return estimates


def step_response(canister: HeatModel, axial_mm: float) -> FloatArray:
    """Rise of the stir zone by tick after a step of 1 kW, while the tool travels.

    After ten minutes of 43.6 kW.
    """
    base = canister.initial()
    power_kw, rises = nominal().operating_power_kw, []
    for _ in range(round(_LONGEST_S / TICK_S)):
        base = canister.step(base, power_kw, _SPEED_MM_PER_S, axial_mm, TICK_S)
    raised = base
    for _ in range(round(_LONGEST_S / TICK_S)):
        base = canister.step(base, power_kw, _SPEED_MM_PER_S, axial_mm, TICK_S)
        raised = canister.step(raised, power_kw + 1.0, _SPEED_MM_PER_S, axial_mm, TICK_S)
        rises.append(
            canister.stir_zone_temperature_c(raised) - canister.stir_zone_temperature_c(base)
        )
    return np.array(rises)


def one_lag(rises: FloatArray, within_s: float) -> tuple[float, float]:
    """Gain [degC/kW] and lag [s] of the single lag that best fits a step response for a time."""
    from scipy.optimize import curve_fit

    seen = rises[: round(within_s / TICK_S)]
    time_s = TICK_S * np.arange(1, seen.size + 1)
    gain_and_lag, _ = curve_fit(
        lambda t, gain, lag: gain * (1.0 - np.exp(-t / lag)), time_s, seen, p0=(16.0, 25.0)
    )
    return float(gain_and_lag[0]), float(gain_and_lag[1])


def steps() -> dict[str, dict[str, Any]]:
    """Step responses and fitted lags of canisters and of (16) without dead time and tool."""
    p = nominal()
    time_s = TICK_S * np.arange(1, round(_LONGEST_S / TICK_S) + 1)
    courses = {"paper (16)": p.thermal_gain_c_per_kw * (1.0 - np.exp(-time_s / p.copper_lag_s))}
    own = PlantConfig.from_values(scenario_file.load(_TRAVERSED).plant).canister
    assert own is not None
    shapes = {"": own, ", default canister": CanisterParameters()}
    for words, parameters in shapes.items():
        courses |= {
            f"{place}{words}": step_response(load_or_compact(parameters), z)
            for place, z in PLACES.items()
        }
    responses: dict[str, dict[str, Any]] = {
        name: {
            "rise_c": {f"{t:g}": float(course[round(t / TICK_S) - 1]) for t in STEP_TIMES_S},
            "lag": one_lag(course, _FITTED_S),
        }
        for name, course in courses.items()
    }
    for words, edge_mm in (("no edge", 1e6), ("edge at 60 mm", 60.0)):
        values = dict(
            zip((f"{t:g}" for t in STEP_TIMES_S), line_source(edge_mm).tolist(), strict=True)
        )
        responses[f"line source in a plate, {words}"] = {"rise_c": values}
    return responses


def line_source(edge_mm: float) -> FloatArray:
    """Rise at the rim of a line source of 25 mm that moves in a plate beside an insulated edge.

    Green's function.

    1 kW in 50 mm, with copper of 350 W/(m K) and 3.75 MJ/(m3 K).
    """
    from scipy.integrate import quad

    k, rho_c, rim_m, speed = 350.0, 3.75e6, 0.025, 1e-3 * _SPEED_MM_PER_S
    alpha = k / rho_c
    turn = (np.arange(24) + 0.5) * np.pi / 12.0
    ahead, aside = rim_m * np.cos(turn), rim_m * np.sin(turn)

    def arriving(age_s: float) -> float:
        along = (ahead + speed * age_s) ** 2
        squares = (along + aside**2, along + (2e-3 * edge_mm - aside) ** 2)
        return float(
            sum(np.exp(-square / (4.0 * alpha * age_s)).mean() for square in squares) / age_s
        )

    ends = (0.0, *STEP_TIMES_S)
    parts = [quad(arriving, a, b, limit=200)[0] for a, b in pairwise(ends)]
    return np.asarray(1e3 / 0.05 / (4.0 * np.pi * k) * np.cumsum(parts))


def weld_course(
    scenario: Scenario, signals: WeldSignals, canister: HeatModel
) -> tuple[ToolCourse, int]:
    """Power, speed and height of a weld from cold on, and the heating steps before it."""
    assert signals.truth is not None
    start = PlantConfig.from_values(scenario.plant)
    path = ToolPath.of(scenario.path, start)
    whole_s = signals.n_ticks * TICK_S
    skipped_s = (
        spans(scenario.phases)[-1][2] - whole_s
    )  # of the dwell, which ends at a temperature
    dwell_s = spans(scenario.phases, whole_s)[0][2]
    power_kw = signals.truth.process_power_kw
    power_kw = (
        power_kw[: power_kw.size // _HELD_TICKS * _HELD_TICKS]
        .reshape(-1, _HELD_TICKS)
        .mean(axis=1)
    )
    steps = _HELD_TICKS * TICK_S * np.arange(power_kw.size)
    motions = [
        path.motion(at_s + skipped_s if at_s >= dwell_s else at_s) for at_s in steps.tolist()
    ]
    first_c, before = float(signals.truth.copper_temperature_c[0]), [0]

    def missing_c(state: CanisterState) -> float:
        before[0] += 1
        return first_c - canister.stir_zone_temperature_c(state)

    heated(canister, start["start.power_kw"], motions[0], _HELD_TICKS * TICK_S, missing_c)
    count = before[0] - 1
    speed, axial = np.array([motions[0]] * count + motions).T
    return ToolCourse(
        np.append(np.full(count, start["start.power_kw"]), power_kw), speed, axial
    ), count


def stir_zone_c(canister: HeatModel, course: ToolCourse, dt_s: float) -> FloatArray:
    """Temperature of the stir zone at the ends of the steps of a course, from a cold canister."""
    state, temperatures_c = canister.initial(axial_mm=float(course.axial_mm[0])), []
    columns = course.power_kw.tolist(), course.traverse_mm_per_s.tolist(), course.axial_mm.tolist()
    for inputs in zip(*columns, strict=True):
        state = canister.step(state, *inputs, dt_s)
        temperatures_c.append(canister.stir_zone_temperature_c(state))
    return np.array(temperatures_c)


def reduced_against_full(
    scenario: Scenario, signals: WeldSignals, progress: Callable[[float], None] | None = None
) -> dict[str, Any]:
    """Distance of the reduced stir zone from all finite elements over a whole weld."""
    parameters = PlantConfig.from_values(scenario.plant).canister
    assert parameters is not None
    canister, fine = load_or_compact(parameters), load_or_reduce(parameters)
    course, before = weld_course(scenario, signals, canister)
    dt_s = _HELD_TICKS * TICK_S
    seen = stir_zone_c(canister, course, dt_s)
    wrong_c = seen - exact_stir_zone_c(parameters, course, dt_s, progress)
    at_s = dt_s * (np.arange(wrong_c.size) + 1 - before)
    phases = [
        ("heating-up", -before * dt_s, 0.0),
        *spans(scenario.phases, signals.n_ticks * TICK_S),
    ]
    inside = {
        name: (at_s > begin_s + 1e-6) & (at_s <= end_s + 1e-6) for name, begin_s, end_s in phases
    }
    return {
        "element_mm": parameters.element_mm,
        "modes": parameters.modes,
        "states": canister.states,
        "fine_states": fine.states,
        "from_fine_c": float(np.abs(seen - stir_zone_c(fine, course, dt_s)).max()),
        "largest_c": float(np.abs(wrong_c).max()),
        "rms_c": float(np.sqrt(np.mean(wrong_c**2))),
        "phases_c": {name: float(np.abs(wrong_c[at]).max()) for name, at in inside.items()},
    }


def compact_errors(parameters: CanisterParameters) -> list[dict[str, Any]]:
    """States of the model by tolerance; largest difference from the decoupled one by speed.

    Twenty minutes of 45 kW +- 5 kW from cold: standing, down from the lid to the joint line, and
    up again.
    """
    fine, projection = load_or_reduce(parameters), projection_of(parameters)
    time_s = np.arange(_COMPARED_S)
    height = np.interp(
        time_s, [300.0, 384.0, 1000.0, 1084.0], [PLACES["lid"], 0.0, 0.0, PLACES["lid"]]
    )
    power = 45.0 + 5.0 * np.sign(np.sin(time_s / 20.0))
    errors = []
    for tolerance_k in _TOLERANCES_K:
        compact = CompactCanister(parameters, compact_of(projection, parameters, tolerance_k))
        largest = {}
        for speed in _TRAVERSES_MM_PER_MIN:
            course = ToolCourse(power, np.where(time_s < 120, 0.0, speed / 60.0), height)
            largest[f"{speed:g}"] = float(
                np.abs(stir_zone_c(compact, course, 1.0) - stir_zone_c(fine, course, 1.0)).max()
            )
        errors.append({"tolerance_k": tolerance_k, "states": compact.states, "largest_c": largest})
    return errors


def whole_weld(scenario: Scenario, signals: WeldSignals) -> dict[str, Any]:
    """The whole weld: mean power of each minute and of each phase."""
    assert signals.truth is not None
    power = signals.truth.process_power_kw
    phases = spans(scenario.phases, signals.n_ticks * TICK_S)
    return {
        "minutes_kw": [
            float(minute.mean()) for minute in np.array_split(power, range(600, power.size, 600))
        ],
        "phases_kw": {
            n: float(power[round(b / TICK_S) : round(e / TICK_S)].mean()) for n, b, e in phases
        },
        "phases_s": {name: [begin, end] for name, begin, end in phases},
    }


def validation(
    progress: Callable[[float], None] | None = None, coarse: bool = False
) -> dict[str, Any]:
    """All numbers of the first page.

    ``coarse``: all finite elements on a mesh that takes a tenth of the time.
    """
    scenario = scenario_file.load(_TRAVERSED, [f"controller={name_of(_CONTROLLER)}"])
    signals = run(scenario, _CONTROLLER)
    result: dict[str, Any] = {
        "identified": {},
        "steps": steps(),
        "weld": whole_weld(scenario, signals),
    }
    own = PlantConfig.from_values(scenario.plant).canister
    assert own is not None
    result["compact"] = compact_errors(own)
    if coarse:
        scenario = scenario_file.load(_TRAVERSED, [f"controller={name_of(_CONTROLLER)}", *COARSE])
        signals = run(scenario, _CONTROLLER)
    result["reduced"] = reduced_against_full(
        scenario, signals, None if progress is None else lambda share: progress(0.5 * share)
    )
    experiments = [(place, when) for place in PLACES for when in TIMES_S]
    for i, (place, when) in enumerate(experiments):
        for words, of in identified(PLACES[place], TIMES_S[when]).items():
            result["identified"][f"{place}, {when}, {words}"] = of
        if progress is not None:
            progress(0.5 + 0.5 * (i + 1) / len(experiments))
    return result


def properties(
    minutes: float,
    progress: Callable[[float], None] | None = None,
    changes: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Temperatures of the stir zone along the whole weld's path, with constant power from cold.

    Of each step ``at_s``, ``phase`` and, by model, ``stir_zone_c``. ``changes`` are parameters of
    the canister instead of the scenario's.
    """
    scenario = scenario_file.load(_TRAVERSED)
    config = PlantConfig.from_values(scenario.plant)
    assert config.canister is not None
    parameters = config.canister.changed(**{**_COARSE, **(changes or {})})
    path = ToolPath.of(scenario.path, config)
    starts_s = [k * _STEP_S for k in range(round(60.0 * minutes / _STEP_S))]
    result: dict[str, Any] = {
        "power_kw": POWER_KW,
        "reference_c": parameters.reference_c,
        "stir_zone_c": {},
    }
    phases = spans(scenario.phases)
    result["at_s"] = [at_s + _STEP_S for at_s in starts_s]
    result["phase"] = [
        next((n for n, a, b in phases if a < t <= b + 1e-6), phases[-1][0]) for t in result["at_s"]
    ]
    for number, (name, (kind, nonlinear)) in enumerate(MODELS.items()):

        def report(share: float, done: int = number) -> None:
            if progress is not None:
                progress((done + share) / len(MODELS))

        full = FullCanister(parameters.changed(properties=kind), _STEP_S, nonlinear)
        result["stir_zone_c"][name] = _course(full, path, starts_s, report)
    return result


def _course(
    full: FullCanister, path: ToolPath, starts_s: list[float], progress: Callable[[float], None]
) -> list[float]:
    """The stir zone at the ends of the steps; within one the tool is where it is in its middle."""
    state, temperatures_c = full.initial(axial_mm=path.motion(0.0).axial_mm), []
    for k, at_s in enumerate(starts_s):
        middle = path.motion(at_s + 0.5 * _STEP_S)
        state = full.step(state, POWER_KW, middle.traverse_mm_per_s, middle.axial_mm)
        temperatures_c.append(round(full.stir_zone_temperature_c(state), 2))
        progress((k + 1) / len(starts_s))
    return temperatures_c
