"""Steps a controller safely: every measurement is answered, whatever the controller does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from traceback import extract_tb

from fsw_control.command_gate import refusal
from fsw_control.contract import Command, Controller, Measurement, Proposal, Reference
from fsw_control.reason import Reason, ReasonCode

#: reason of a controller without set-points
NO_SET_POINT = Reason(ReasonCode.NO_SET_POINT)


def answer(
    controller: Controller,
    measurement: Measurement,
    reference: Reference | None,
    applied: Command,
    dt_s: float,
) -> Proposal:
    """Step ``controller`` and return its proposal, marked unhealthy if it must not be applied.

    It is unhealthy, with a :class:`~fsw_control.reason.Reason`, if the controller raises, if its
    command is not finite, if a sensor that it needs is invalid, or if there is no set-point yet
    (the controller is not stepped then). An unusable command is replaced by ``applied``. The
    arguments are those of :meth:`fsw_control.Controller.step`.
    """
    if reference is None:
        return Proposal(applied, healthy=False, reason=NO_SET_POINT)
    m, needed = measurement, []
    try:
        proposal = controller.step(measurement, reference, applied, dt_s)
        refused = refusal(proposal.command)
        if proposal.healthy not in (True, False) or not isinstance(proposal.reason, str | Reason):
            raise TypeError(f"healthy is {proposal.healthy!r}, reason is {proposal.reason!r}")
        if not (m.depth_valid and m.torque_valid and m.temperature_valid):
            tolerated = controller.tolerated_sensors
            needed = [name for name in m.invalid_sensors() if name not in tolerated]
    except Exception as error:
        # A user's controller may fail in any way; the weld must continue under another one.
        raised = Reason(ReasonCode.RAISED, detail=_detail(error))
        return Proposal(applied, healthy=False, reason=raised)
    if refused is not None:
        return Proposal(applied, False, refused.reason, proposal.diagnosis)
    if proposal.healthy and needed:
        reason = Reason(ReasonCode.INVALID_SENSOR, tuple(needed))
        return replace(proposal, healthy=False, reason=reason)
    if isinstance(proposal.reason, str):
        return replace(proposal, reason=Reason.of(proposal.reason))
    return proposal


def _detail(error: Exception) -> str:
    """The error in one line, with the place in the controller's file where it was raised."""
    frame = extract_tb(error.__traceback__)[-1]
    where = "" if frame.filename == __file__ else f" ({Path(frame.filename).name}:{frame.lineno})"
    return f"{type(error).__name__}: {' '.join(str(error).split())}{where}"
