"""Requests of operators on the page: models, each with its text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from fsw_control.contract import OperatorMode
from fsw_control.ranges import (
    COMMAND_FORCE_KN,
    COMMAND_SPEED_RPM,
    REFERENCE_DEPTH_MM,
    REFERENCE_TEMPERATURE_C,
)
from fsw_control.schema.models import InputError, Many, Model, Problem, validate
from fsw_control.schema.ranges import Range

_Name = Annotated[str, Field(pattern="^[A-Za-z0-9_]{1,100}$")]
_AlarmId = Annotated[str, Field(min_length=1, max_length=250)]


class Action(Model):
    """An action in the graph."""

    words: ClassVar[str]  #: for the record, with its fields

    def __str__(self) -> str:
        return self.words.format_map(dict(self))


class SafeStop(Action):
    """The safe state, at once."""

    words = "safe stop"


class AcknowledgeStop(Action):
    """Acknowledgement of a safe stop, which may then be left."""

    words = "acknowledge the safe stop"


class SetReference(Action):
    """New set-points, at once or as a ramp from those in force."""

    depth_mm: Annotated[float, REFERENCE_DEPTH_MM]
    temperature_c: Annotated[float, REFERENCE_TEMPERATURE_C]
    ramp: bool = False

    def __str__(self) -> str:
        return (
            f"set-points {self.depth_mm:g} mm, {self.temperature_c:g} "
            f"°C{', ramp' if self.ramp else ''}"
        )


class Switch(Action):
    """Another controller; ``wait_s``: how long to wait until it is ready."""

    words = "switch to {controller}"
    controller: _Name
    wait_s: Annotated[float, Range(0.0, 10.0, "s")] = 0.0


class ChangeMode(Action):
    """Another mode; force and speed are for ``manual``."""

    mode: OperatorMode
    force_kn: Annotated[float, COMMAND_FORCE_KN] | None = None
    speed_rpm: Annotated[float, COMMAND_SPEED_RPM] | None = None

    @model_validator(mode="after")
    def _check_command(self) -> ChangeMode:
        if self.mode == "manual" and (self.force_kn is None or self.speed_rpm is None):
            raise ValueError("manual needs force_kn and speed_rpm")
        return self

    def __str__(self) -> str:
        return f"mode {self.mode}" + (
            f" {self.force_kn:g} kN, {self.speed_rpm:g} rpm" if self.mode == "manual" else ""
        )


class Programme(Action):
    """Hold, resume or abort the programme of the weld."""

    words = "weld {action}"
    action: Literal["hold", "resume", "abort"]


class Acknowledge(Action):
    """Alarms that have been seen: some, or all up to the newest that was on the page."""

    ids: Annotated[Many[_AlarmId], Field(max_length=200)] = ()
    up_to: Annotated[int, Field(ge=1)] | None = None  #: number of the newest

    @model_validator(mode="after")
    def _check_alarms(self) -> Acknowledge:
        if bool(self.ids) == (self.up_to is not None):
            raise ValueError("give ids or up_to")
        return self

    def __str__(self) -> str:
        if self.up_to is not None:
            return "acknowledge all alarms"
        return f"acknowledge {', '.join(self.ids[:3])}{' ...' if len(self.ids) > 3 else ''}"


class Shelve(Action):
    """Shelving of an alarm for some minutes, with a reason."""

    words = "shelve {alarm} for {minutes:g} min: {reason}"
    alarm: _AlarmId
    minutes: Annotated[float, Range(1.0, 60.0, "min")]
    reason: Annotated[str, Field(min_length=1, max_length=100)]

    @model_validator(mode="after")
    def _check_reason(self) -> Shelve:
        if not self.reason.strip() or not self.reason.isprintable():
            raise ValueError("say why in words")
        return self


class Unshelve(Action):
    """Unshelving of an alarm."""

    words = "unshelve {alarm}"
    alarm: _AlarmId


#: by the request's name
ACTIONS: dict[Any, type[Action]] = {
    "safe_stop": SafeStop,
    "acknowledge_stop": AcknowledgeStop,
    "set_reference": SetReference,
    "switch": Switch,
    "mode": ChangeMode,
    "weld": Programme,
    "acknowledge": Acknowledge,
    "shelve": Shelve,
    "unshelve": Unshelve,
}


def read(do: str, message: Mapping[str, Any]) -> Action:
    """Action of a request.

    Raises
    ------
    fsw_control.schema.models.InputError
        When there is none of this name, or a value is missing, of the wrong type or out of range.
    """
    if do not in ACTIONS:
        raise InputError("there is no such request", problems=(Problem("", "no_request"),))
    model = ACTIONS[do]
    return validate(model, {key: message[key] for key in model.model_fields if key in message}, do)
