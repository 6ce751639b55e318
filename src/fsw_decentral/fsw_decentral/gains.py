"""Gains of the decentralized controller and its documented sets."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Annotated, Any

import yaml
from pydantic import NonNegativeFloat, PositiveFloat

from fsw_control.schema.models import Model
from fsw_control.schema.ranges import Range


class Gains(Model):
    """Tuning of the three loops; decoupling and Smith predictor are off at 0.

    Raises
    ------
    ValueError
        If one is out of its range, or an integral or tracking time is 0.
    """

    depth_gain: Annotated[NonNegativeFloat, Range(0.0, 500.0, "kN/mm")]
    """Proportional gain of the depth loop, axial force per depth error."""
    depth_integral_time: Annotated[PositiveFloat, Range(0.0, 1000.0, "s")]
    """Integral time of the depth loop."""
    depth_derivative_time: Annotated[NonNegativeFloat, Range(0.0, 10.0, "s")]
    """Derivative time of the depth loop, on the measurement."""
    depth_filter: Annotated[NonNegativeFloat, Range(0.0, 10.0, "s")]
    """Time constant of each of the two filters in series for the measured depth."""
    depth_weight: Annotated[NonNegativeFloat, Range(0.0, 1.0, "")]
    """Set-point weight of the depth loop's proportional part."""
    depth_reference_filter: Annotated[NonNegativeFloat, Range(0.0, 60.0, "s")]
    """Time constant of the filter for the depth set-point."""
    depth_tracking_time: Annotated[PositiveFloat, Range(0.0, 1000.0, "s")]
    """Tracking time of the depth loop (back-calculation) while a limit is active."""
    temperature_gain: Annotated[NonNegativeFloat, Range(0.0, 10.0, "kW/degC")]
    """Proportional gain of the temperature loop, power per temperature error."""
    temperature_integral_time: Annotated[PositiveFloat, Range(0.0, 1000.0, "s")]
    """Integral time of the temperature loop."""
    temperature_derivative_time: Annotated[NonNegativeFloat, Range(0.0, 10.0, "s")]
    """Derivative time of the temperature loop, on the measurement."""
    temperature_filter: Annotated[NonNegativeFloat, Range(0.0, 10.0, "s")]
    """Time constant of each of the two filters in series for the measured temperature."""
    temperature_weight: Annotated[NonNegativeFloat, Range(0.0, 1.0, "")]
    """Set-point weight of the temperature loop's proportional part."""
    temperature_reference_filter: Annotated[NonNegativeFloat, Range(0.0, 60.0, "s")]
    """Time constant of the filter for the temperature set-point."""
    temperature_tracking_time: Annotated[PositiveFloat, Range(0.0, 1000.0, "s")]
    """Tracking time of the temperature loop (back-calculation) while the speed is at a limit."""
    power_gain: Annotated[NonNegativeFloat, Range(0.0, 20.0, "rpm/kW")]
    """Proportional gain of the power loop, spindle speed per power error."""
    power_integral_time: Annotated[PositiveFloat, Range(0.0, 1000.0, "s")]
    """Integral time of the power loop."""
    power_filter: Annotated[NonNegativeFloat, Range(0.0, 10.0, "s")]
    """Time constant of the filter for the measured torque in the power loop."""
    power_tracking_time: Annotated[PositiveFloat, Range(0.0, 1000.0, "s")]
    """Tracking time of the power loop (back-calculation) while the move limit of the speed is
    active."""
    feedforward_filter: Annotated[NonNegativeFloat, Range(0.0, 10.0, "s")]
    """Time constant of the filter for the measured torque in the feed-forward."""
    decoupling_torque: Annotated[NonNegativeFloat, Range(0.0, 200.0, "N m/kN")] = 0.0
    """Process torque caused by the axial force; the speed makes up for it before it is
    measured. 0: no decoupling."""
    decoupling_lag: Annotated[NonNegativeFloat, Range(0.0, 10.0, "s")] = 0.0
    """Time constant with which the torque follows the force."""
    predictor_gain: Annotated[NonNegativeFloat, Range(0.0, 1000.0, "degC/kW")] = 0.0
    """Smith predictor: temperature over power in the linear model."""
    predictor_copper_lag: Annotated[NonNegativeFloat, Range(0.0, 1000.0, "s")] = 0.0
    """Smith predictor: time constant of the heated copper."""
    predictor_tool_lag: Annotated[NonNegativeFloat, Range(0.0, 100.0, "s")] = 0.0
    """Smith predictor: time constant of the tool with the thermocouple."""
    predictor_dead_time: Annotated[NonNegativeFloat, Range(0.0, 10.0, "s")] = 0.0
    """Smith predictor: dead time of the temperature; 0: no predictor."""

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
