"""Parameters of the decentralized controller, its gains and their documented sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import resources
from typing import Annotated, Any, Literal

import yaml
from pydantic import NonNegativeFloat, PositiveFloat, create_model

from fsw_control.common_parameters import ControllerLimits, numbers
from fsw_control.schema.models import Model, descriptions, range_of
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


class Friction(Model):
    """Parameters ``friction.*``."""

    constant: Annotated[float, Range(-1000.0, 1000.0, "N m")] = 243.11
    """Friction torque of motor and transmission at standstill, equation (23)."""
    linear: Annotated[float, Range(-10.0, 10.0, "N m/rpm")] = -1.305
    """Coefficient of the speed in the friction torque, equation (23)."""
    quadratic: Annotated[float, Range(-0.1, 0.1, "N m/rpm2")] = 0.001927
    """Coefficient of the squared speed in the friction torque, equation (23)."""


class _Tuning(ControllerLimits):
    """The set of gains, and the bounds."""

    tuning: Literal["conservative", "tight", "smith"] = "conservative"
    """Named set of gains, computed by fsw.tune (lab)."""


def _of_tuning(name: str, text: str) -> tuple[Range, float, str]:
    """Parameter of a gain."""
    bounds = replace(range_of(Gains, name), low=-1.0)
    return bounds, -1.0, f"{text.removesuffix('.')}; negative: value of the tuning"


_GAINS = {name: _of_tuning(name, text) for name, text in descriptions(Gains).items()}
_WITH_GAINS: Any = create_model("DecentralGains", __base__=_Tuning, **numbers(_GAINS))


class DecentralParameters(_WITH_GAINS):  # type: ignore[misc]
    """Parameters of the decentralized controller.

    A negative gain stands for that of the tuning.
    """

    friction: Friction = Friction()
    spindle_inertia: Annotated[float, Range(0.0, 100.0, "kg m2")] = 2.0
    """Inertia of the spindle, as seen in the motor torque while the spindle accelerates."""
    nominal_torque: Annotated[float, Range(100.0, 3000.0, "N m")] = 1021.53
    """Process torque used until the first valid torque sample."""
    blind_limit: Annotated[float, Range(0.0, 600.0, "s")] = 15.0
    """Maximum time without torque or temperature for which proposals stay healthy."""
