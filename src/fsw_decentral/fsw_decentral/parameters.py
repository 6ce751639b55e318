"""Parameters of the decentralized controller."""

from __future__ import annotations

from typing import Annotated, Literal

from fsw_control import weld
from fsw_control.parameters import NodeParameters
from fsw_control.schema.models import Model
from fsw_control.schema.ranges import Range


class Friction(Model):
    """Parameters ``friction.*``."""

    constant: Annotated[float, Range(-1000.0, 1000.0, "N m")] = 243.11
    """Friction torque of motor and transmission at standstill, equation (23)."""
    linear: Annotated[float, Range(-10.0, 10.0, "N m/rpm")] = -1.305
    """Coefficient of the speed in the friction torque, equation (23)."""
    quadratic: Annotated[float, Range(-0.1, 0.1, "N m/rpm2")] = 0.001927
    """Coefficient of the squared speed in the friction torque, equation (23)."""


class DecentralParameters(NodeParameters):
    """Parameters of the decentralized controller. A negative gain stands for that of the tuning."""

    tuning: Literal["conservative", "tight", "smith"] = "conservative"
    """Named set of gains, computed by fsw.tune (lab)."""
    depth_gain: Annotated[float, Range(-1.0, 500.0, "kN/mm")] = -1.0
    """Proportional gain of the depth loop, axial force per depth error; negative: value of the
    tuning."""
    depth_integral_time: Annotated[float, Range(-1.0, 1000.0, "s")] = -1.0
    """Integral time of the depth loop; negative: value of the tuning."""
    depth_derivative_time: Annotated[float, Range(-1.0, 10.0, "s")] = -1.0
    """Derivative time of the depth loop, on the measurement; negative: value of the tuning."""
    depth_filter: Annotated[float, Range(-1.0, 10.0, "s")] = -1.0
    """Time constant of each of the two filters in series for the measured depth; negative: value
    of the tuning."""
    depth_weight: Annotated[float, Range(-1.0, 1.0, "")] = -1.0
    """Set-point weight of the depth loop's proportional part; negative: value of the tuning."""
    depth_reference_filter: Annotated[float, Range(-1.0, 60.0, "s")] = -1.0
    """Time constant of the filter for the depth set-point; negative: value of the tuning."""
    depth_tracking_time: Annotated[float, Range(-1.0, 1000.0, "s")] = -1.0
    """Tracking time of the depth loop (back-calculation) while a limit is active; negative: value
    of the tuning."""
    temperature_gain: Annotated[float, Range(-1.0, 10.0, "kW/degC")] = -1.0
    """Proportional gain of the temperature loop, power per temperature error; negative: value of
    the tuning."""
    temperature_integral_time: Annotated[float, Range(-1.0, 1000.0, "s")] = -1.0
    """Integral time of the temperature loop; negative: value of the tuning."""
    temperature_derivative_time: Annotated[float, Range(-1.0, 10.0, "s")] = -1.0
    """Derivative time of the temperature loop, on the measurement; negative: value of the
    tuning."""
    temperature_filter: Annotated[float, Range(-1.0, 10.0, "s")] = -1.0
    """Time constant of each of the two filters in series for the measured temperature; negative:
    value of the tuning."""
    temperature_weight: Annotated[float, Range(-1.0, 1.0, "")] = -1.0
    """Set-point weight of the temperature loop's proportional part; negative: value of the
    tuning."""
    temperature_reference_filter: Annotated[float, Range(-1.0, 60.0, "s")] = -1.0
    """Time constant of the filter for the temperature set-point; negative: value of the tuning."""
    temperature_tracking_time: Annotated[float, Range(-1.0, 1000.0, "s")] = -1.0
    """Tracking time of the temperature loop (back-calculation) while the speed is at a limit;
    negative: value of the tuning."""
    power_gain: Annotated[float, Range(-1.0, 20.0, "rpm/kW")] = -1.0
    """Proportional gain of the power loop, spindle speed per power error; negative: value of the
    tuning."""
    power_integral_time: Annotated[float, Range(-1.0, 1000.0, "s")] = -1.0
    """Integral time of the power loop; negative: value of the tuning."""
    power_filter: Annotated[float, Range(-1.0, 10.0, "s")] = -1.0
    """Time constant of the filter for the measured torque in the power loop; negative: value of
    the tuning."""
    power_tracking_time: Annotated[float, Range(-1.0, 1000.0, "s")] = -1.0
    """Tracking time of the power loop (back-calculation) while the move limit of the speed is
    active; negative: value of the tuning."""
    feedforward_filter: Annotated[float, Range(-1.0, 10.0, "s")] = -1.0
    """Time constant of the filter for the measured torque in the feed-forward; negative: value of
    the tuning."""
    decoupling_torque: Annotated[float, Range(-1.0, 200.0, "N m/kN")] = -1.0
    """Process torque caused by the axial force; the speed makes up for it before it is measured.
    0: no decoupling; negative: value of the tuning."""
    decoupling_lag: Annotated[float, Range(-1.0, 10.0, "s")] = -1.0
    """Time constant with which the torque follows the force; negative: value of the tuning."""
    predictor_gain: Annotated[float, Range(-1.0, 1000.0, "degC/kW")] = -1.0
    """Smith predictor: temperature over power in the linear model; negative: value of the
    tuning."""
    predictor_copper_lag: Annotated[float, Range(-1.0, 1000.0, "s")] = -1.0
    """Smith predictor: time constant of the heated copper; negative: value of the tuning."""
    predictor_tool_lag: Annotated[float, Range(-1.0, 100.0, "s")] = -1.0
    """Smith predictor: time constant of the tool with the thermocouple; negative: value of the
    tuning."""
    predictor_dead_time: Annotated[float, Range(-1.0, 10.0, "s")] = -1.0
    """Smith predictor: dead time of the temperature; 0: no predictor; negative: value of the
    tuning."""
    force_min: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_MIN_KN
    """Minimum axial force."""
    force_max: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_MAX_KN
    """Maximum axial force."""
    speed_min: Annotated[float, Range(1.0, 1000.0, "rpm")] = weld.SPEED_MIN_RPM
    """Minimum spindle speed."""
    speed_max: Annotated[float, Range(1.0, 1000.0, "rpm")] = weld.SPEED_MAX_RPM
    """Maximum spindle speed."""
    force_step: Annotated[float, Range(0.001, 10.0, "kN")] = weld.FORCE_STEP_KN
    """Maximum change of the axial force per tick."""
    speed_step: Annotated[float, Range(0.001, 100.0, "rpm")] = weld.SPEED_STEP_RPM
    """Maximum change of the spindle speed per tick."""
    friction: Friction = Friction()
    spindle_inertia: Annotated[float, Range(0.0, 100.0, "kg m2")] = 2.0
    """Inertia of the spindle, as seen in the motor torque while the spindle accelerates."""
    nominal_torque: Annotated[float, Range(100.0, 3000.0, "N m")] = 1021.53
    """Process torque used until the first valid torque sample."""
    blind_limit: Annotated[float, Range(0.0, 600.0, "s")] = 15.0
    """Maximum time without torque or temperature for which proposals stay healthy."""
