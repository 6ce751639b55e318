"""Gains of the decentralized controller and its documented sets of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib import resources
from math import isfinite
from typing import Any

import yaml


@dataclass(frozen=True, slots=True)
class Gains:
    """All tuning of the three loops; names, units and meaning are those of the parameters in ``decentral.yaml``.

    Raises
    ------
    ValueError
        When one is negative or not finite, or an integral or tracking time is 0.
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
        for name, value in asdict(self).items():
            if not isfinite(value) or value < 0.0:
                raise ValueError(f"gain {name} is {value!r}, must be finite and not negative")
            if value == 0.0 and name.endswith(("integral_time", "tracking_time")):
                raise ValueError(f"gain {name} must be positive")

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Gains:
        """Gains of the set ``values["tuning"]``, but those of ``values`` itself that are not negative.

        Raises
        ------
        ValueError
            When there is no such set, or a gain is not usable.
        """
        sets = tunings()
        if values["tuning"] not in sets:
            raise ValueError(f"tuning {values['tuning']!r} is none of {', '.join(sets)}")
        gains = asdict(sets[values["tuning"]])
        return cls(**gains | {name: values[name] for name in gains if values.get(name, -1.0) >= 0.0})


@cache
def tunings() -> Mapping[str, Gains]:
    """Return the documented sets of gains by name; ``scripts/tune_decentral.py`` computes them."""
    text = resources.files("fsw_decentral").joinpath("tunings.yaml").read_text(encoding="utf-8")
    return {name: Gains(**gains) for name, gains in yaml.safe_load(text).items()}
