"""The standard cases.

Steps of both set-points and of a disturbance of both outputs, as in the paper's Figs. 6 to 9.

The paper gives neither their sizes nor their times; both are chosen.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import accumulate
from typing import Any, NamedTuple

import yaml

from fsw_control import Reference
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_scenario import scenario_file
from fsw_scenario.scenario import Scenario

CONSERVATIVE, TIGHT, SMITH = "decentral:conservative", "decentral:tight", "decentral:smith"
DEFAULT = "nmpc:default"
REST = Reference(DEPTH_MM, TEMPERATURE_C)


class Step(NamedTuple):
    """A lasting change of a set-point or of an output disturbance: when, and by how much."""

    at_s: float
    depth_mm: float = 0.0
    temperature_c: float = 0.0

    @property
    def of_depth(self) -> bool:
        """Whether it is a step of the depth, not of the temperature."""
        return self.depth_mm != 0.0

    @property
    def size(self) -> str:
        """Its size in words, e.g. "+0.2 mm"."""
        text = f"{self.depth_mm:+g} mm" if self.of_depth else f"{self.temperature_c:+g} °C"
        return text.replace("-", "−")

    @property
    def disturbance(self) -> dict[str, Any]:
        """The disturbance of the output, as in a scenario file."""
        if self.of_depth:
            return {"channel": "depth", "shape": "step", "amplitude_mm": self.depth_mm}
        return {"channel": "temperature", "shape": "step", "amplitude_c": self.temperature_c}

    def after(self, reference: Reference) -> Reference:
        """The set-points that follow these ones."""
        return Reference(
            reference.depth_mm + self.depth_mm, reference.temperature_c + self.temperature_c
        )


SET_POINTS = {
    "z up": Step(40.0, depth_mm=0.2),
    "T up": Step(80.0, temperature_c=10.0),
    "z down": Step(120.0, depth_mm=-0.2),
    "T down": Step(160.0, temperature_c=-10.0),
}
DISTURBANCES = {"dz": Step(40.0, depth_mm=0.1), "dT": Step(100.0, temperature_c=-5.0)}
#: Events of the two cases, each case from rest at the operating point, and how long a case takes.
CASES = {"tracking": SET_POINTS, "disturbances": DISTURBANCES}
DURATION_S = {"tracking": 200.0, "disturbances": 160.0}
#: All events, by name.
EVENTS = SET_POINTS | DISTURBANCES


def set_points() -> list[Reference]:
    """The set-points before the first step, and after each one."""
    return list(
        accumulate(
            SET_POINTS.values(), lambda reference, step: step.after(reference), initial=REST
        )
    )


def events(case: str, begin_s: float = 0.0) -> list[dict[str, Any]]:
    """Events of one of ``CASES`` that begins at a time, as in a scenario file."""
    if case == "disturbances":
        return [
            {"at_s": begin_s + step.at_s, "disturbance": step.disturbance}
            for step in DISTURBANCES.values()
        ]
    return [
        {
            "at_s": begin_s + step.at_s,
            "reference": {"depth_mm": after.depth_mm, "temperature_c": after.temperature_c},
        }
        for step, after in zip(SET_POINTS.values(), set_points()[1:], strict=True)
    ]


def cut_joint_line(content: dict[str, Any], end_deg: float) -> None:
    """Let the joint line of a scenario file's content end sooner [deg].

    The phases after it follow, later events go.
    """
    phases = {phase["name"]: phase for phase in content["phases"]}
    sooner_deg = phases["joint_line"]["to_deg"] - end_deg
    for name in ("joint_line", "overlap", "parking"):
        phases[name]["to_deg"] -= sooner_deg
    content["events"] = [
        event for event in content["events"] if event.get("at_deg", 0.0) <= end_deg
    ]


def scenario(case: str, plant: Mapping[str, float | bool | str], controller: str) -> Scenario:
    """One of ``CASES``, or a scenario by file or name, with parameters of the plant."""
    overrides = [
        f"controller={controller}",
        *(f"plant.{name}={json.dumps(of)}" for name, of in plant.items()),
    ]
    if case not in CASES:
        return scenario_file.load(case, overrides)
    text = yaml.safe_dump({"name": case, "duration_s": DURATION_S[case], "events": events(case)})
    return scenario_file.parse(text, case, overrides)
