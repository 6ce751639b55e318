"""Ranges in parameter descriptors."""

from __future__ import annotations

import math
from typing import Any

from rcl_interfaces import msg
from rclpy.parameter import Parameter

#: Relative tolerance for bounds and steps of floating point ranges.
PARAM_REL_TOL = 1e-6


def range_error(parameter: Parameter, descriptor: msg.ParameterDescriptor) -> str | None:
    """Return why the value is outside the descriptor's range; None if it is inside or there is no range."""
    exact = parameter.type_ is Parameter.Type.INTEGER
    ranges: list[Any] = descriptor.integer_range if exact else descriptor.floating_point_range
    if not ranges or not (exact or parameter.type_ is Parameter.Type.DOUBLE):
        return None
    name, value, step = parameter.name, parameter.value, ranges[0].step
    low, high = sorted((ranges[0].from_value, ranges[0].to_value))

    def same(one: float, other: float) -> bool:
        return one == other if exact else math.isclose(one, other, rel_tol=PARAM_REL_TOL)

    # Values on the edge are always allowed, whatever the step.
    if same(value, low) or same(value, high):
        return None
    if not low < value < high:
        return f"Parameter {name} out of range{'.' if exact else ''} Min: {low}, Max: {high}, value: {value}"
    if not step:
        return None
    steps = (value - low) // step if exact else round((value - low) / step)
    if same(value, low + steps * step):
        return None
    what = "a valid step" if exact else "close enough to a valid step"
    return f"The parameter value for {name} is not {what}. Min: {low}, max: {high}, value: {value}, step: {step}"
