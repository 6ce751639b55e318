"""What controllers are compared on: events, and processes that differ from the model."""

from __future__ import annotations

import json
import random
from collections.abc import Mapping
from typing import Any

import yaml

from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_model import nominal
from fsw_plant.event_schema import DISTURBANCE_AMPLITUDE
from fsw_scenario import scenario_file
from fsw_scenario.scenario import Scenario
from fsw_scenario.standard_events import DISTURBANCES, DURATION_S, SET_POINTS, set_points

CONSERVATIVE, TIGHT = "decentral:conservative", "decentral:tight"
PAPER, DEFAULT = "nmpc:paper", "nmpc:default"
DECENTRALIZED = (CONSERVATIVE, TIGHT)
CONTROLLERS = (*DECENTRALIZED, PAPER, DEFAULT)
DEAD_TIME_S = nominal().dead_time_s

Event = dict[str, Any]


def _set_point(at_s: float, **values: float) -> Event:
    return {"at_s": at_s, "reference": values}


def _disturbance(at_s: float, channel: str, amplitude: float) -> Event:
    key, _ = DISTURBANCE_AMPLITUDE[channel]
    return {"at_s": at_s, "disturbance": {"channel": channel, "shape": "step", key: amplitude}}


_STANDARD = {
    "tracking": [
        _set_point(step.at_s, depth_mm=after.depth_mm, temperature_c=after.temperature_c)
        for step, after in zip(SET_POINTS.values(), set_points()[1:], strict=True)
    ],
    "disturbances": [
        _disturbance(step.at_s, *(("depth", step.depth_mm) if step.of_depth else ("temperature", step.temperature_c)))
        for step in DISTURBANCES.values()
    ],
}
#: Own cases, as changes from the operating point; other names are scenarios shipped with fsw_scenario.
_OWN: dict[str, tuple[float, list[Event]]] = {
    **{case: (DURATION_S[case], events) for case, events in _STANDARD.items()},
    "rest": (300.0, []),
    "small_steps": (
        220.0,
        [_set_point(2.0, depth_mm=DEPTH_MM + 0.01), _set_point(4.0, temperature_c=TEMPERATURE_C + 0.5)],
    ),
    "other_sizes": (
        300.0,
        [
            _set_point(10.0, depth_mm=DEPTH_MM + 0.06),
            _set_point(50.0, depth_mm=DEPTH_MM - 0.09),
            _set_point(90.0, temperature_c=TEMPERATURE_C + 4.0),
            _set_point(130.0, temperature_c=TEMPERATURE_C - 8.0),
            _disturbance(180.0, "depth", -0.12),
            _disturbance(220.0, "temperature", 7.0),
            _disturbance(265.0, "depth", 0.03),
        ],
    ),
    "input_disturbances": (
        160.0,
        [_disturbance(20.0, "axial_force", 1.0), _disturbance(80.0, "spindle_speed", -4.0)],
    ),
}
VALIDATION_CASES = (
    "other_sizes",
    "input_disturbances",
    "ramp_and_sine",
    "simultaneous_events",
    "quick",
    "saturation",
)

#: Processes that differ from the model: factors on its parameters, and the plant's own parameters.
SWEEP: dict[str, dict[str, float]] = {
    "nominal": {},
    **{f"thermal gain × {k:g}": {"model.thermal_gain_c_per_kw": k} for k in (0.5, 0.7, 1.4, 2.0)},
    **{f"depth gain × {k:g}": {"model.depth_gain_mm_per_kn_s": k} for k in (0.5, 0.7, 1.4, 2.0)},
    **{
        f"torque × {k:g}": {"model.sliding_friction": k, "model.sticking_stress_pa": k}
        for k in (0.5, 0.7, 0.85, 1.15, 1.4, 2.0)
    },
    **{f"softening × {k:g}": {"model.softening_per_c": k} for k in (0.5, 0.7, 1.4, 2.0)},
    **{f"thermal lag × {k:g}": {"model.copper_lag_s": k} for k in (0.5, 2.0)},
    **{f"dead time {s:g} s": {"model.dead_time_s": s / DEAD_TIME_S} for s in (1.8, 3.8)},
    "drive lag 0.3 s": {"actuators.lag_s": 0.3},
}
#: The nine of the count of wins.
FIXED = (
    "thermal gain × 0.7",
    "thermal gain × 1.4",
    "depth gain × 0.7",
    "depth gain × 1.4",
    "softening × 0.5",
    "softening × 2",
    "dead time 1.8 s",
    "dead time 3.8 s",
    "drive lag 0.3 s",
)
#: Of the random processes: independent, uniform.
RANDOM: dict[str, tuple[float, float]] = {
    "model.thermal_gain_c_per_kw": (0.7, 1.4),
    "model.copper_lag_s": (0.7, 1.4),
    "model.tool_lag_s": (0.5, 2.0),
    "model.depth_gain_mm_per_kn_s": (0.7, 1.4),
    "model.depth_zero_s": (0.8, 1.25),
    "model.sliding_friction": (0.9, 1.1),
    "model.softening_per_c": (0.5, 2.0),
    "model.dead_time_s": (1.8 / DEAD_TIME_S, 3.8 / DEAD_TIME_S),
}


def random_factors(
    count: int, spans: Mapping[str, tuple[float, float]] = RANDOM, seed: int = 2026
) -> list[dict[str, float]]:
    """Factors of `count` processes, drawn independently and uniformly."""
    generator = random.Random(seed)
    return [{name: generator.uniform(*span) for name, span in spans.items()} for _ in range(count)]


def scenario(case: str, plant: Mapping[str, float | bool] | None = None, controller: str = "decentral") -> Scenario:
    """A case as a scenario, with parameters of the plant, e.g. ``noise`` or ``model.<name>``."""
    overrides = [f"controller={controller}", *(f"plant.{name}={json.dumps(of)}" for name, of in (plant or {}).items())]
    if case not in _OWN:
        return scenario_file.load(case, overrides)
    duration_s, events = _OWN[case]
    text = yaml.safe_dump({"name": case, "duration_s": duration_s, "events": events})
    return scenario_file.parse(text, case, overrides)
