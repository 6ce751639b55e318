"""Gains of the decentralized controller and its documented sets."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

import yaml
from pydantic import Field, NonNegativeFloat, PositiveFloat

from fsw_control.schema.models import Model


class Gains(Model):
    """Tuning of the three loops; names, units and meaning are those of the parameters.

    Raises
    ------
    ValueError
        If one is negative or not finite, or an integral or tracking time is 0.
    """

    depth_gain: NonNegativeFloat
    depth_integral_time: PositiveFloat
    depth_derivative_time: NonNegativeFloat
    depth_filter: NonNegativeFloat
    depth_weight: NonNegativeFloat
    depth_reference_filter: NonNegativeFloat
    depth_tracking_time: PositiveFloat
    temperature_gain: NonNegativeFloat
    temperature_integral_time: PositiveFloat
    temperature_derivative_time: NonNegativeFloat
    temperature_filter: NonNegativeFloat
    temperature_weight: NonNegativeFloat
    temperature_reference_filter: NonNegativeFloat
    temperature_tracking_time: PositiveFloat
    power_gain: NonNegativeFloat
    power_integral_time: PositiveFloat
    power_filter: NonNegativeFloat
    power_tracking_time: PositiveFloat
    feedforward_filter: NonNegativeFloat
    #: of the decoupling and of the Smith predictor; 0: off
    decoupling_torque: NonNegativeFloat = 0.0
    decoupling_lag: NonNegativeFloat = 0.0
    predictor_gain: NonNegativeFloat = 0.0
    predictor_copper_lag: NonNegativeFloat = 0.0
    predictor_tool_lag: NonNegativeFloat = 0.0
    predictor_dead_time: float = Field(0.0, ge=0.0, le=10.0)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Gains:
        """Gains of the set ``values["tuning"]``, overridden by non-negative ones in ``values``.

        Raises
        ------
        ValueError
            If there is no such set, or a gain is not usable.
        """
        sets = tunings()
        if values["tuning"] not in sets:
            raise ValueError(f"tuning {values['tuning']!r} is not one of {', '.join(sets)}")
        chosen = {name: values[name] for name in cls.model_fields if values.get(name, -1.0) >= 0.0}
        return sets[values["tuning"]].changed(**chosen)


@cache
def tunings() -> Mapping[str, Gains]:
    """Return the documented sets of gains by name; ``fsw.tune`` computes them."""
    text = resources.files("fsw_decentral").joinpath("tunings.yaml").read_text(encoding="utf-8")
    return {name: Gains(**gains) for name, gains in yaml.safe_load(text).items()}
