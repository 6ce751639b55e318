"""The decentralized controller: temperature by spindle speed through a power loop, depth by axial force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_control import weld
from fsw_control.contract import Command, Diagnosis, Limits, Measurement, Proposal, Reference
from fsw_control.parameters import defaults, load
from fsw_decentral.gains import Gains, tunings
from fsw_decentral.loops import KW_PER_NM_RPM, FeedbackLoop, PowerLoop, configure

#: rad/s2 per rpm/s
_RAD_PER_RPM = KW_PER_NM_RPM * 1e3
#: two commands nearer than this (kN, rpm) are the same one, rounded on the wire
_SAME = 1e-6
_NOMINAL_STEP_S = 0.1
_LONGEST_STEP_S = 1.0
_NO_LIMITS: tuple[str, ...] = ()


class DecentralController:
    """Two single loops side by side, as on the welding machine.

    Outer PI: temperature to power reference; inner loop: power to spindle speed (feed-forward by the measured
    torque, plus PI); PI(D): depth to axial force. The proposal keeps the bounds and the move limits, relative to the
    applied command, which every loop follows: so it is without a bump when it gets selected.

    Without torque the power loop goes on with the last torque, without temperature the power reference is held; both
    for ``blind_limit`` seconds. Without depth the force is held and the proposal is not healthy.

    Parameters
    ----------
    values : mapping of str to Any, optional
        Parameters as described in ``decentral.yaml``; what is missing has its default.

    Raises
    ------
    ValueError
        When a gain is not usable.
    """

    name = "decentral"
    tolerated_sensors: tuple[str, ...] = ("torque", "thermocouple")

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        self._sets = tunings()
        self._values = defaults(load("fsw_decentral", "decentral.yaml"))
        self._dt_s = _NOMINAL_STEP_S
        self._start_loops()
        self.configure({} if values is None else values)
        self.reset(Command(weld.FORCE_KN, weld.SPEED_RPM))

    def _start_loops(self) -> None:
        self._depth = FeedbackLoop()
        self._temperature = FeedbackLoop()
        self._power = PowerLoop(float(self._values["nominal_torque"]))
        self._power_started = False

    @property
    def gains(self) -> Gains:
        """The gains in use."""
        return self._gains

    def check(self, values: Mapping[str, Any]) -> str | None:
        """Return why these parameters cannot be used, or None."""
        try:
            self._gains_of(values)
            self._limits_of(values)
        except (KeyError, ValueError) as error:
            return str(error)
        return None

    def configure(self, values: Mapping[str, Any]) -> None:
        """Take new parameters at runtime; the outputs do not jump.

        Raises
        ------
        ValueError
            When a gain is not usable.
        """
        merged = self._values | dict(values)
        gains, limits = self._gains_of(merged), self._limits_of(merged)
        self._values, self._gains, self.limits = merged, gains, limits
        self._friction = tuple(float(merged[f"friction.{name}"]) for name in ("constant", "linear", "quadratic"))
        self._inertia = float(merged["spindle_inertia"]) * _RAD_PER_RPM
        self._blind_limit_s = float(merged["blind_limit"])
        configure(self._depth, self._temperature, self._power, gains, self._dt_s)

    def _gains_of(self, values: Mapping[str, Any]) -> Gains:
        return self._sets[values["tuning"]].overridden(values)

    @staticmethod
    def _limits_of(values: Mapping[str, Any]) -> Limits:
        if not values["force_min"] < values["force_max"]:
            raise ValueError("force_min must be below force_max")
        if not values["speed_min"] < values["speed_max"]:
            raise ValueError("speed_min must be below speed_max")
        return Limits(
            force_min_kn=values["force_min"],
            force_max_kn=values["force_max"],
            speed_min_rpm=values["speed_min"],
            speed_max_rpm=values["speed_max"],
            force_step_kn=values["force_step"],
            speed_step_rpm=values["speed_step"],
        )

    def reset(self, applied: Command) -> None:
        """Forget the past; the next step starts from ``applied``."""
        self._start_loops()
        configure(self._depth, self._temperature, self._power, self._gains, self._dt_s)
        self._proposed = applied
        self._speed_before_rpm = applied.speed_rpm
        self._reference = Reference(float("nan"), float("nan"))
        self._blind_torque_s = 0.0
        self._blind_temperature_s = 0.0
        self._bad_cycles = 0

    def step(self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float) -> Proposal:
        """Return the proposal that answers ``measurement``; see ``fsw_control.Controller``."""
        if dt_s != self._dt_s:
            self._change_step(dt_s)
        if not _finite(applied.force_kn + applied.speed_rpm):
            applied = self._proposed
        if _finite(reference.depth_mm + reference.temperature_c):
            self._reference = reference
        wanted = Command(
            self._wanted_force_kn(measurement, applied.force_kn),
            self._wanted_speed_rpm(measurement, applied.speed_rpm),
        )
        reason = self._reason(measurement)
        if not _finite(wanted.force_kn + wanted.speed_rpm):
            # Finite but absurd samples have overflowed the loops: start again from what is applied.
            self._start_loops()
            configure(self._depth, self._temperature, self._power, self._gains, self._dt_s)
            wanted, reason = applied, "samples beyond all range, loops start again"
        self._proposed = self.limits.clip(wanted, applied)
        if reason:
            self._bad_cycles += 1
        touched = _NO_LIMITS
        if self._proposed.force_kn != wanted.force_kn or self._proposed.speed_rpm != wanted.speed_rpm:
            touched = self.limits.active(self._proposed, applied)
        diagnosis = Diagnosis(
            self._depth.measured,
            self._temperature.measured,
            self._power.fast_nm,
            active_limits=touched,
            bad_cycles=self._bad_cycles,
        )
        return Proposal(self._proposed, not reason, reason, diagnosis)

    def _change_step(self, dt_s: float) -> None:
        usable = min(dt_s, _LONGEST_STEP_S) if dt_s > 0.0 else _NOMINAL_STEP_S
        if usable != self._dt_s:
            self._dt_s = usable
            configure(self._depth, self._temperature, self._power, self._gains, usable)

    def _wanted_force_kn(self, measurement: Measurement, applied_kn: float) -> float:
        loop, depth = self._depth, measurement.depth_mm
        if not (measurement.depth_valid and _finite(depth)) or not _finite(self._reference.depth_mm):
            loop.pause(applied_kn)
            return applied_kn
        if not loop.started:
            loop.start(depth, self._reference.depth_mm, applied_kn)
        else:
            proposed = self._proposed.force_kn
            elsewhere = not -_SAME < applied_kn - proposed < _SAME
            excess = (applied_kn if elsewhere else proposed) - loop.output
            if excess:
                loop.follow(excess, elsewhere)
        return loop.step(depth, self._reference.depth_mm)

    def _wanted_speed_rpm(self, measurement: Measurement, applied_rpm: float) -> float:
        loop, power = self._temperature, self._power
        elsewhere = not -_SAME < applied_rpm - self._proposed.speed_rpm < _SAME
        if self._power_started:
            excess_rpm = (applied_rpm if elsewhere else self._proposed.speed_rpm) - power.output
            if excess_rpm:
                kw_per_rpm = power.slow_nm * KW_PER_NM_RPM
                bounded = not self.limits.speed_min_rpm < self._proposed.speed_rpm < self.limits.speed_max_rpm
                power.follow(excess_rpm, bounded, elsewhere)
                if elsewhere and not loop.started:
                    loop.output = applied_rpm * kw_per_rpm
                elif elsewhere:
                    loop.follow(applied_rpm * kw_per_rpm - loop.output, True)
                elif bounded and loop.started:
                    # what the move limit delays the power loop makes up for; what a bound takes is lost
                    excess_kw = self._proposed.speed_rpm * kw_per_rpm - loop.output
                    if excess_kw * excess_rpm > 0.0:
                        loop.follow(excess_kw, False)
        self._measure_torque(measurement, applied_rpm)
        temperature = measurement.temperature_c
        if measurement.temperature_valid and _finite(temperature) and _finite(self._reference.temperature_c):
            self._blind_temperature_s = 0.0
            if not loop.started:
                held_kw = loop.output if _finite(loop.output) else power.slow_nm * applied_rpm * KW_PER_NM_RPM
                loop.start(temperature, self._reference.temperature_c, held_kw)
            power_kw = loop.step(temperature, self._reference.temperature_c)
        else:
            self._blind_temperature_s += self._dt_s
            if not _finite(loop.output):
                loop.output = power.slow_nm * applied_rpm * KW_PER_NM_RPM
            loop.pause(loop.output)
            power_kw = loop.output
        return power.step(power_kw, applied_rpm)

    def _measure_torque(self, measurement: Measurement, applied_rpm: float) -> None:
        """Take the process torque: motor torque less friction (23) and less what accelerates the spindle."""
        acceleration_rpm_per_s = (applied_rpm - self._speed_before_rpm) / self._dt_s
        self._speed_before_rpm = applied_rpm
        if measurement.torque_valid and _finite(measurement.torque_nm):
            self._blind_torque_s = 0.0
            constant, linear, quadratic = self._friction
            friction_nm = constant + (linear + quadratic * applied_rpm) * applied_rpm
            torque_nm = measurement.torque_nm - friction_nm - self._inertia * acceleration_rpm_per_s
            # No contact, no power: the feed-forward divides by the torque.
            torque_nm = max(torque_nm, 100.0)
            if self._power_started:
                self._power.measure(torque_nm)
            else:
                self._power.start(torque_nm)
        else:
            self._blind_torque_s += self._dt_s
        self._power_started = True

    def _reason(self, measurement: Measurement) -> str:
        if not self._depth.started:
            return "no valid depth, force held"
        if self._blind_torque_s > self._blind_limit_s:
            return f"no valid torque for more than {self._blind_limit_s:g} s"
        if self._blind_temperature_s > self._blind_limit_s:
            return f"no valid temperature for more than {self._blind_limit_s:g} s"
        return ""


def _finite(value: float) -> bool:
    return value - value == 0.0
