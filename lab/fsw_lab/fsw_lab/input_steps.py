"""Steps of force and speed, and the response of the bare process: no drives, sensors or noise."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, model_validator

from fsw_control.schema.models import (
    Many,
    Model,
    content_of,
    problem,
    read_text,
    shipped_names,
    validate,
)
from fsw_control.schema.ranges import Range
from fsw_control.weld import TICK_S
from fsw_model import ProcessModel
from fsw_plant.event_schema import DURATION_S, TIME_S

COLUMNS = (
    "time_s",
    "depth_mm",
    "temperature_c",
    "motor_torque_nm",
    "process_torque_nm",
    "power_kw",
    "force_kn",
    "speed_rpm",
)
_SHIPPED = Path(__file__).parent / "events"
#: simulated time after the last event by default
_AFTERWARDS_S = 30.0
_TICKS_PER_S = round(1.0 / TICK_S)


def _on_a_tick(time_s: float) -> float:
    if abs(time_s * _TICKS_PER_S - round(time_s * _TICKS_PER_S)) > 1e-6:
        raise ValueError(f"is {time_s:g}: give a multiple of {TICK_S:g} s")
    return time_s


class InputStep(Model):
    """New inputs from a time on; an omitted one is kept. The ranges far exceed real drives'."""

    at_s: Annotated[float, TIME_S, AfterValidator(_on_a_tick)]
    force_kn: Annotated[float, Range(0.0, 1000.0, "kN")] | None = None
    speed_rpm: Annotated[float, Range(0.0, 10_000.0, "rpm")] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.force_kn is None and self.speed_rpm is None:
            raise ValueError("needs force_kn or speed_rpm")
        return self


class InputSteps(Model):
    """Content of a file of input steps."""

    events: Many[InputStep]
    duration_s: Annotated[float, DURATION_S, AfterValidator(_on_a_tick)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        before_s = 0.0
        for i, step in enumerate(self.events):
            if step.at_s < before_s:
                raise problem(
                    "is earlier than the step before it; list steps in order of time", "events", i
                )
            if self.duration_s is not None and step.at_s > self.duration_s:
                raise problem(f"is after the end at {self.duration_s:g} s", "events", i)
            before_s = step.at_s
        return self

    @property
    def last_tick(self) -> int:
        """Last tick of the simulation."""
        latest_s = self.events[-1].at_s if self.events else 0.0
        return round(
            _TICKS_PER_S
            * (latest_s + _AFTERWARDS_S if self.duration_s is None else self.duration_s)
        )


def shipped() -> list[str]:
    """Names of the shipped files of input steps."""
    return shipped_names(_SHIPPED)


def read(source: str) -> InputSteps:
    """Read input steps from a file or a shipped one by name; InputError if invalid."""
    content = content_of(read_text(source, "events", _SHIPPED), source)
    return validate(
        InputSteps, {"events": content} if isinstance(content, list) else content, source
    )


def simulate(steps: InputSteps, model: ProcessModel) -> dict[str, Any]:
    """Response of the process from the operating point, columns with a value per tick.

    Raises
    ------
    fsw_model.OperatingPointError
        If the shoulder leaves the copper.
    """
    start = model.equilibrium()
    inputs = {
        name: np.full(steps.last_tick + 1, getattr(start, name))
        for name in ("force_kn", "speed_rpm")
    }
    for step in steps.events:
        for name, values in inputs.items():
            if getattr(step, name) is not None:
                values[round(step.at_s * _TICKS_PER_S) :] = getattr(step, name)
    course = model.simulate(inputs["force_kn"].tolist(), inputs["speed_rpm"].tolist(), start)
    course["time_s"] = course["time_s"].round(6)  # whole tenths, as in the file
    return {name: course[name] for name in COLUMNS}
