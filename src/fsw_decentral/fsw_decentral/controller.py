"""The decentralized controller: a thin binding of the C library."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fsw_control import weld
from fsw_control.c_library import CController, CLibrary
from fsw_control.contract import Command, Diagnosis, Limits, Measurement, Proposal, Reference
from fsw_control.parameters import defaults, problem
from fsw_control.reason import Reason, ReasonCode
from fsw_decentral.parameters import DecentralParameters, Gains

KERNEL = CLibrary("fsw_decentral", Path(__file__).parent / "kernel")
Fault = KERNEL.enum("fsw_decentral_reason", "FSW_DECENTRAL_")
Limit = KERNEL.enum("fsw_decentral_limit", "FSW_DECENTRAL_")
_UNUSABLE = (
    "limits, friction, spindle_inertia, nominal_torque and blind_limit "
    "must be finite and in their ranges"
)


class DecentralController:
    """Two single loops side by side, as on the welding machine, in a C library (``kernel/``).

    Cascade for the temperature: an outer PI gives a power reference; the inner loop gives the
    spindle speed, by feedforward with the measured torque plus PI. PI(D) from depth to axial
    force. The proposal keeps the bounds and the move limits relative to the applied command,
    which every loop tracks, so selecting it is bumpless. If the applied command is so far outside
    the bounds that both are impossible, the proposal is at the bound and not healthy.

    Without torque the power loop continues with the last torque, without temperature the power
    reference is held; both for ``blind_limit`` seconds. Without depth the force is held and the
    proposal is not healthy.

    Parameters
    ----------
    values : mapping of str to Any, optional
        Parameters as described by :class:`DecentralParameters`; missing ones have their default.

    Raises
    ------
    ValueError
        If the values are not usable or the library cannot be built.
    """

    name = "decentral"
    parameters, variant = DecentralParameters, "tuning"
    tolerated_sensors: tuple[str, ...] = ("torque", "thermocouple")

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        self._values = defaults(self.parameters) | dict(values or {})
        try:
            self.gains, self.limits, tuning = _usable(self._values)
            self.library = CController(KERNEL, None, _UNUSABLE, tuning)
        except (RuntimeError, OSError) as error:
            raise ValueError(f"decentral: {error}") from None
        self.reset(Command(weld.FORCE_KN, weld.SPEED_RPM))

    def check(self, values: Mapping[str, Any]) -> str | None:
        """Return why these parameters cannot be used, or None."""
        return problem(_usable, self._values | dict(values))

    def configure(self, values: Mapping[str, Any]) -> None:
        """Apply new parameters at runtime, bumplessly; an error changes nothing."""
        merged = self._values | dict(values)
        self.gains, self.limits, tuning = _usable(merged)
        self._values = merged
        self.library.configure(tuning)

    def reset(self, applied: Command) -> None:
        """Forget the past; the next step starts from ``applied``."""
        self.library.reset(applied.force_kn, applied.speed_rpm)

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        """Return the proposal that answers ``measurement``; see ``fsw_control.Controller``."""
        m, inputs, outputs = measurement, self.library.input, self.library.output
        self.library.take(m, reference, applied, dt_s)
        inputs.depth_valid, inputs.torque_valid = m.depth_valid, m.torque_valid
        inputs.temperature_valid = m.temperature_valid
        self.library.step()
        touched = outputs.active_limits
        diagnosis = Diagnosis(
            outputs.depth_mm,
            outputs.temperature_c,
            outputs.torque_nm,
            active_limits=tuple(limit.name.lower() for limit in Limit if touched & limit)
            if touched
            else (),
            bad_cycles=outputs.bad_cycles,
        )
        reason = self._reason(outputs.reason) if outputs.reason else Reason()
        return Proposal(
            Command(outputs.force_kn, outputs.speed_rpm), bool(outputs.healthy), reason, diagnosis
        )

    def _reason(self, fault: int) -> Reason:
        if fault == Fault.NO_DEPTH:
            return Reason(ReasonCode.FORCE_HELD, ("depth",))
        if fault == Fault.OVERFLOW:
            return Reason(ReasonCode.OVERFLOW)
        if fault == Fault.OUT_OF_BOUNDS:
            return Reason(ReasonCode.OUT_OF_BOUNDS)
        sensor = "torque" if fault == Fault.NO_TORQUE else "thermocouple"
        return Reason(ReasonCode.BLIND, (sensor,), self._values["blind_limit"])


def _usable(values: Mapping[str, Any]) -> tuple[Gains, Limits, Any]:
    """All data for the library (gains, limits); raises ValueError if it would reject them."""
    gains, limits = Gains.of(values), Limits.of(values)
    tuning = KERNEL.new(
        "fsw_decentral_tuning",
        **dict(gains),
        **asdict(limits),
        friction=tuple(values[f"friction.{name}"] for name in ("constant", "linear", "quadratic")),
        spindle_inertia_kgm2=values["spindle_inertia"],
        nominal_torque_nm=values["nominal_torque"],
        blind_limit_s=values["blind_limit"],
    )
    if not KERNEL.lib.fsw_decentral_is_usable(tuning):
        raise ValueError(_UNUSABLE)
    return gains, limits, tuning
