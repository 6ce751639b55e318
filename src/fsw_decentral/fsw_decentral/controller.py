"""The decentralized controller: temperature by spindle speed through a power loop, depth by axial force."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, nan
from typing import Any

from fsw_control import weld
from fsw_control.contract import Command, Diagnosis, Limits, Measurement, Proposal, Reference
from fsw_control.parameters import defaults, load, problem
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_decentral.gains import Gains
from fsw_decentral.loops import KW_PER_NM_RPM, FeedbackLoop, PowerLoop

#: two commands nearer than this (kN, rpm) are the same one, rounded on the wire
_SAME = 1e-6
_LONGEST_STEP_S = 1.0
#: Less counts as this: without contact there is no power, and the feed-forward divides by the torque.
_LEAST_TORQUE_NM = 100.0


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

    Attributes
    ----------
    gains : Gains
        In use.
    limits : Limits

    Raises
    ------
    ValueError
        When gains or limits are not usable.
    """

    name = "decentral"
    tolerated_sensors: tuple[str, ...] = ("torque", "thermocouple")

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        self._values = defaults(load("fsw_decentral", "decentral.yaml"))
        self._use(values or {})
        self.reset(Command(weld.FORCE_KN, weld.SPEED_RPM))

    def check(self, values: Mapping[str, Any]) -> str | None:
        """Return why these parameters cannot be used, or None."""
        return problem(_usable, self._values | dict(values))

    def configure(self, values: Mapping[str, Any]) -> None:
        """Take new parameters at runtime; the outputs do not jump. Raises as the class does, and changes nothing."""
        self._use(values)
        self._configure_loops()

    def _use(self, values: Mapping[str, Any]) -> None:
        merged = self._values | dict(values)
        self.gains, self.limits = _usable(merged)
        self._values = merged

    def _configure_loops(self) -> None:
        gains, dt_s = self.gains, self._dt_s
        self._depth.configure(**gains.loop("depth"), dt_s=dt_s)
        self._temperature.configure(**gains.loop("temperature"), dt_s=dt_s)
        self._power.configure(**gains.loop("power"), feedforward_filter=gains.feedforward_filter, dt_s=dt_s)

    def _start_loops(self) -> None:
        self._depth = FeedbackLoop()
        self._temperature = FeedbackLoop()
        self._power = PowerLoop(self._values["nominal_torque"])
        self._configure_loops()

    def reset(self, applied: Command) -> None:
        """Forget the past; the next step starts from ``applied``."""
        self._dt_s = weld.TICK_S
        self._start_loops()
        self._proposed = applied
        self._speed_before_rpm = applied.speed_rpm
        self._reference = Reference(nan, nan)
        self._blind_torque_s = 0.0
        self._blind_temperature_s = 0.0
        self._bad_cycles = 0

    def step(self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float) -> Proposal:
        """Return the proposal that answers ``measurement``; see ``fsw_control.Controller``."""
        usable_s = min(dt_s, _LONGEST_STEP_S) if dt_s > 0.0 else weld.TICK_S
        if usable_s != self._dt_s:
            self._dt_s = usable_s
            self._configure_loops()
        if not isfinite(applied.force_kn + applied.speed_rpm):
            applied = self._proposed
        if isfinite(reference.depth_mm + reference.temperature_c):
            self._reference = reference
        wanted = Command(
            self._wanted_force_kn(measurement, applied.force_kn),
            self._wanted_speed_rpm(measurement, applied.speed_rpm),
        )
        reason = self._reason()
        if not isfinite(wanted.force_kn + wanted.speed_rpm):
            # Finite but absurd samples have overflowed the loops: start again from what is applied.
            self._start_loops()
            wanted, reason = applied, "samples beyond all range, loops start again"
        self._proposed = self.limits.clip(wanted, applied)
        self._bad_cycles += bool(reason)
        diagnosis = Diagnosis(
            self._depth.measured,
            self._temperature.measured,
            self._power.fast_nm,
            active_limits=() if self._proposed == wanted else self.limits.active(self._proposed, applied),
            bad_cycles=self._bad_cycles,
        )
        return Proposal(self._proposed, not reason, reason, diagnosis)

    def _wanted_force_kn(self, measurement: Measurement, applied_kn: float) -> float:
        loop, depth, wanted = self._depth, measurement.depth_mm, self._reference.depth_mm
        if not (measurement.depth_valid and isfinite(depth) and isfinite(wanted)):
            loop.pause(applied_kn)
            return applied_kn
        if not loop.started:
            loop.start(depth, wanted, applied_kn)
        else:
            proposed = self._proposed.force_kn
            elsewhere = abs(applied_kn - proposed) >= _SAME
            excess = (applied_kn if elsewhere else proposed) - loop.output
            if excess:
                loop.follow(excess, elsewhere)
        return loop.step(depth, wanted)

    def _wanted_speed_rpm(self, measurement: Measurement, applied_rpm: float) -> float:
        loop, power, wanted = self._temperature, self._power, self._reference.temperature_c
        if power.started:
            self._follow_speed(applied_rpm)
        self._measure_torque(measurement, applied_rpm)
        temperature = measurement.temperature_c
        if not isfinite(loop.output):
            loop.output = power.slow_nm * applied_rpm * KW_PER_NM_RPM
        if measurement.temperature_valid and isfinite(temperature) and isfinite(wanted):
            self._blind_temperature_s = 0.0
            if not loop.started:
                loop.start(temperature, wanted, loop.output)
            loop.step(temperature, wanted)
        else:
            self._blind_temperature_s += self._dt_s
            loop.pause(loop.output)
        return power.step(loop.output, applied_rpm)

    def _follow_speed(self, applied_rpm: float) -> None:
        """Tell power and temperature loop what became of the speed."""
        loop, power, proposed_rpm = self._temperature, self._power, self._proposed.speed_rpm
        elsewhere = abs(applied_rpm - proposed_rpm) >= _SAME
        excess_rpm = (applied_rpm if elsewhere else proposed_rpm) - power.output
        if not excess_rpm:
            return
        kw_per_rpm = power.slow_nm * KW_PER_NM_RPM
        bounded = not self.limits.speed_min_rpm < proposed_rpm < self.limits.speed_max_rpm
        power.follow(excess_rpm, bounded, elsewhere)
        if elsewhere and not loop.started:
            loop.output = applied_rpm * kw_per_rpm
        elif elsewhere:
            loop.follow(applied_rpm * kw_per_rpm - loop.output, True)
        elif bounded and loop.started:
            # what the move limit delays the power loop makes up for; what a bound takes is lost
            excess_kw = proposed_rpm * kw_per_rpm - loop.output
            if excess_kw * excess_rpm > 0.0:
                loop.follow(excess_kw, False)

    def _measure_torque(self, measurement: Measurement, applied_rpm: float) -> None:
        """Take the process torque: motor torque less friction (23) and less what accelerates the spindle."""
        acceleration_rpm_per_s = (applied_rpm - self._speed_before_rpm) / self._dt_s
        self._speed_before_rpm = applied_rpm
        if not (measurement.torque_valid and isfinite(measurement.torque_nm)):
            self._blind_torque_s += self._dt_s
            return
        self._blind_torque_s = 0.0
        constant, linear, quadratic = (self._values[f"friction.{name}"] for name in ("constant", "linear", "quadratic"))
        friction_nm = constant + (linear + quadratic * applied_rpm) * applied_rpm
        inertia = self._values["spindle_inertia"] * RAD_PER_S_PER_RPM
        torque_nm = measurement.torque_nm - friction_nm - inertia * acceleration_rpm_per_s
        self._power.measure(max(torque_nm, _LEAST_TORQUE_NM))

    def _reason(self) -> str:
        blind_limit_s = self._values["blind_limit"]
        if not self._depth.started:
            return "no valid depth, force held"
        if self._blind_torque_s > blind_limit_s:
            return f"no valid torque for more than {blind_limit_s:g} s"
        if self._blind_temperature_s > blind_limit_s:
            return f"no valid temperature for more than {blind_limit_s:g} s"
        return ""


def _usable(values: Mapping[str, Any]) -> tuple[Gains, Limits]:
    return Gains.of(values), Limits.of(values)
