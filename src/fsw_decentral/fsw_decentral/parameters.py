"""Parameters of the decentralized controller."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import create_model

from fsw_control.common_parameters import ControllerLimits, numbers
from fsw_control.schema.models import Model, descriptions, range_of
from fsw_control.schema.ranges import Range
from fsw_decentral.gains import Gains


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
