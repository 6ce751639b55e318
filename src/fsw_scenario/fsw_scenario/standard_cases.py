"""The cases that controllers are compared on, as scenarios, and the controllers, as they are shipped."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import yaml

from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_plant.event_schema import DISTURBANCE_AMPLITUDE
from fsw_scenario import scenario_file
from fsw_scenario.scenario import Scenario
from fsw_scenario.standard_events import DISTURBANCES, DURATION_S, SET_POINTS, set_points

CONSERVATIVE, TIGHT = "decentral:conservative", "decentral:tight"
PAPER, DEFAULT = "nmpc:paper", "nmpc:default"
DECENTRALIZED = (CONSERVATIVE, TIGHT)
CONTROLLERS = (*DECENTRALIZED, PAPER, DEFAULT)

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


def scenario(case: str, plant: Mapping[str, float | bool] | None = None, controller: str = "decentral") -> Scenario:
    """A case as a scenario, with parameters of the plant, e.g. ``noise`` or ``model.<name>``."""
    overrides = [f"controller={controller}", *(f"plant.{name}={json.dumps(of)}" for name, of in (plant or {}).items())]
    if case not in _OWN:
        return scenario_file.load(case, overrides)
    duration_s, events = _OWN[case]
    text = yaml.safe_dump({"name": case, "duration_s": duration_s, "events": events})
    return scenario_file.parse(text, case, overrides)
