"""Emulations of the control before the cascade. All numbers are chosen; no fit uses them.

Without a power loop the depth loop of today oscillates with the heat (temperature, depth, force,
torque), and the machine did not have it then: in all of them an operator corrects the force.
Speed gains are those of the paper's model with the force held.
"""

from __future__ import annotations

from math import pi

from fsw_control import weld
from fsw_control.contract import Command, Limits, Measurement, Proposal, Reference
from fsw_model import nominal

_P = nominal()
#: dM/dz of the paper's model at the operating point [N m/mm], (19)-(22)
TORQUE_NM_PER_MM = 120.8
#: share of a temperature change that returns: it changes the depth (27), so the torque and the
#: heat
RETURNING = (
    _P.softening_per_c * _P.operating_depth_mm * TORQUE_NM_PER_MM
    * weld.SPEED_RPM * pi / 30000.0 * _P.thermal_gain_c_per_kw
)  # fmt: skip
#: rise of the temperature by the speed in the end, (24) and (16), and its time constant
GAIN_C_PER_RPM = (
    _P.thermal_gain_c_per_kw * _P.operating_power_kw / weld.SPEED_RPM / (1.0 - RETURNING)
)
LAG_S = _P.copper_lag_s / (1.0 - RETURNING)
#: an operator corrects half of an error, unless it is smaller than this
CORRECTED, IGNORED_C, IGNORED_MM = 0.5, 5.0, 0.05
FORCE_KN_PER_MM = 5.0  #: of the correction of the force
#: closed-loop time constant for which the single loop is tuned (SIMC, Skogestad 2003)
CLOSED_LOOP_S = 30.0


class ByHand:
    """An operator corrects force and speed once a minute."""

    name = "by_hand"
    tolerated_sensors: tuple[str, ...] = ()
    look_s = 60.0  #: period of the operator's looks

    def __init__(self) -> None:
        self._limits = Limits()
        self.reset(Command(weld.FORCE_KN, weld.SPEED_RPM))

    def reset(self, applied: Command) -> None:
        """Start from ``applied``."""
        self._target, self._look_at_s, self._error_c = applied, 0.0, 0.0

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        """Return the proposal that answers ``measurement``."""
        looks = measurement.time_s >= self._look_at_s
        error_c = reference.temperature_c - measurement.temperature_c
        error_mm = reference.depth_mm - measurement.depth_mm
        force_kn, speed_rpm = self._target
        speed_rpm += self.change_rpm(error_c, looks, dt_s)
        if looks:
            self._look_at_s = measurement.time_s + self.look_s
            force_kn += FORCE_KN_PER_MM * error_mm if abs(error_mm) > IGNORED_MM else 0.0
        self._target = self._limits.clip(Command(force_kn, speed_rpm), None)
        return Proposal(self._limits.clip(self._target, applied))

    def change_rpm(self, error_c: float, looks: bool, dt_s: float) -> float:
        """Change of the speed at a tick."""
        if not looks or abs(error_c) <= IGNORED_C:
            return 0.0
        return CORRECTED * error_c / GAIN_C_PER_RPM


class OftenByHand(ByHand):
    """An operator with more practice, who looks every 20 s."""

    name = "often_by_hand"
    look_s = 20.0


class SingleLoop(ByHand):
    """One PI controller from the temperature to the speed, without a loop for the power."""

    name = "single_loop"

    def change_rpm(self, error_c: float, looks: bool, dt_s: float) -> float:
        """Change of the speed at a tick: a PI controller in velocity form, without windup."""
        gain = LAG_S / (GAIN_C_PER_RPM * (CLOSED_LOOP_S + _P.tool_lag_s + _P.dead_time_s))
        change_c = error_c - self._error_c + error_c * dt_s / LAG_S
        self._error_c = error_c
        return gain * change_c
