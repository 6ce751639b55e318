"""Gains of the decentralized controller and its documented sets of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib import resources
from math import isfinite
from typing import Any

import yaml


@dataclass(frozen=True, slots=True)
class Gains:
    """All tuning of the three loops.

    Attributes
    ----------
    depth_gain : float
        Force per depth error, kN/mm.
    depth_integral_time, depth_derivative_time : float
        s; derivative acts on the measurement, 0 switches it off.
    depth_filter : float
        Time constant of each of the two first-order filters of the measurement in series, s.
    depth_weight : float
        Share of the set-point that enters the proportional part, 0 to 1.
    depth_reference_filter : float
        Time constant of the set-point's filter, s.
    depth_tracking_time : float
        Time constant of back-calculation while limits act, s.
    temperature_gain : float
        Power per temperature error, kW/degC; the other ``temperature_*`` as for depth, but for the tracking time, which
        counts while the speed is at a bound only.
    power_gain : float
        Speed per power error, rpm/kW.
    power_integral_time, power_filter : float
        s; the filter is that of the measured torque.
    power_tracking_time : float
        Time constant of back-calculation while the move limit acts, s. A long one keeps the energy that is missing
        while the speed cannot follow, and the loop makes up for it afterwards.
    feedforward_filter : float
        Time constant of the filter of the torque that turns the power reference into speed, s.
    """

    depth_gain: float
    depth_integral_time: float
    depth_derivative_time: float
    depth_filter: float
    depth_weight: float
    depth_reference_filter: float
    depth_tracking_time: float
    temperature_gain: float
    temperature_integral_time: float
    temperature_derivative_time: float
    temperature_filter: float
    temperature_weight: float
    temperature_reference_filter: float
    temperature_tracking_time: float
    power_gain: float
    power_integral_time: float
    power_filter: float
    power_tracking_time: float
    feedforward_filter: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isfinite(value) or value < 0.0:
                raise ValueError(f"gain {field.name} is {value!r}, must be finite and not negative")
            if value == 0.0 and field.name.endswith(("integral_time", "tracking_time")):
                raise ValueError(f"gain {field.name} must be positive")

    def overridden(self, values: Mapping[str, Any]) -> Gains:
        """Return a copy with the gains in ``values`` that are not negative; a negative one leaves the gain alone."""
        own = {field.name for field in fields(self)}
        return replace(self, **{name: value for name, value in values.items() if name in own and value >= 0.0})


def tunings() -> dict[str, Gains]:
    """Return the documented sets of gains by name; ``scripts/tune_decentral.py`` computes them."""
    return dict(_tunings())


@cache
def _tunings() -> dict[str, Gains]:
    text = resources.files("fsw_decentral").joinpath("tunings.yaml").read_text(encoding="utf-8")
    return {name: Gains(**gains) for name, gains in yaml.safe_load(text).items()}
