"""Ranges in parameter descriptors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rclpy.parameter import Parameter

if TYPE_CHECKING:
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

#: Relative tolerance for bounds and steps of floating point ranges.
PARAM_REL_TOL = 1e-6


def range_error(parameter: Parameter, descriptor: ParameterDescriptor) -> str | None:
    """Return why the value is outside the descriptor's range; None if it is inside or there is no range."""
    if parameter.type_ is Parameter.Type.INTEGER and descriptor.integer_range:
        return _integer_error(parameter, descriptor.integer_range[0])
    if parameter.type_ is Parameter.Type.DOUBLE and descriptor.floating_point_range:
        return _floating_point_error(parameter, descriptor.floating_point_range[0])
    return None


def _integer_error(parameter: Parameter, allowed: IntegerRange) -> str | None:
    value = parameter.value
    low, high = sorted((allowed.from_value, allowed.to_value))
    # Values on the edge are always allowed, whatever the step.
    if value in (low, high):
        return None
    if not low < value < high:
        return f"Parameter {parameter.name} out of range. Min: {low}, Max: {high}, value: {value}"
    if allowed.step and (value - low) % allowed.step:
        return (
            f"The parameter value for {parameter.name} is not a valid step. "
            f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
        )
    return None


def _floating_point_error(parameter: Parameter, allowed: FloatingPointRange) -> str | None:
    value = parameter.value
    low, high = sorted((allowed.from_value, allowed.to_value))
    if math.isclose(value, low, rel_tol=PARAM_REL_TOL) or math.isclose(value, high, rel_tol=PARAM_REL_TOL):
        return None
    if not low < value < high:
        return f"Parameter {parameter.name} out of range Min: {low}, Max: {high}, value: {value}"
    if allowed.step:
        nearest = low + round((value - low) / allowed.step) * allowed.step
        if not math.isclose(nearest, value, rel_tol=PARAM_REL_TOL):
            return (
                f"The parameter value for {parameter.name} is not close enough to a valid step. "
                f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
            )
    return None
