"""Why a command must not be applied, or why its source commands: an enum with its arguments.

The words that people read are made here, from one table, and nowhere read again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from fsw_control.coded import Coded


class ReasonCode(Coded):
    """Kind of a reason; numbered as in ``Reason.msg``, which says what each means."""

    NONE = 0
    OTHER = 1
    NO_SET_POINT = 2
    INVALID_SENSOR = 3
    RAISED = 4
    BAD_COMMAND = 5
    WAITING_FOR_SENSORS = 6
    NOT_WELDING = 7
    NO_REFERENCE = 8
    BLIND = 9
    OUT_OF_BOUNDS = 10
    SOLVER = 11
    CAUTION = 12
    FORCE_HELD = 13
    OVERFLOW = 14
    HORIZON = 15
    STATE = 20
    SLEWING = 21
    FOREIGN = 22
    INCOMPLETE = 23
    NO_SAMPLES = 24
    STALLED = 25
    UNKNOWN = 255


_WORDS = {
    ReasonCode.NONE: "",
    ReasonCode.OTHER: "{detail}",
    ReasonCode.NO_SET_POINT: "no set-point yet",
    ReasonCode.INVALID_SENSOR: "invalid sensor: {sensors}",
    ReasonCode.RAISED: "controller raised {detail}",
    ReasonCode.BAD_COMMAND: "command is {detail}",
    ReasonCode.WAITING_FOR_SENSORS: "waiting for valid sensors: {sensors}",
    ReasonCode.NOT_WELDING: "waiting: depth and temperature are not those of a weld",
    ReasonCode.NO_REFERENCE: "no usable reference",
    ReasonCode.BLIND: "no valid {sensors} for more than {limit_s:g} s",
    ReasonCode.OUT_OF_BOUNDS: "the applied command is more than a move outside the bounds",
    ReasonCode.SOLVER: "solver: {detail}",
    ReasonCode.CAUTION: "adapting with caution: {detail}",
    ReasonCode.FORCE_HELD: "no valid {sensors}, force held",
    ReasonCode.OVERFLOW: "samples beyond all range, loops start again",
    ReasonCode.HORIZON: "another horizon cannot be made: {detail}",
    ReasonCode.STATE: "{detail}",
    ReasonCode.SLEWING: "slewing after a swap",
    ReasonCode.FOREIGN: "the controller has followed a foreign command",
    ReasonCode.INCOMPLETE: "the measurement lacks {sensors}",
    ReasonCode.NO_SAMPLES: "only the drives' feedback has arrived, no sensor sample",
    ReasonCode.STALLED: "the arbiter was stalled",
    ReasonCode.UNKNOWN: "reason not on record",
}


class Reason(NamedTuple):
    """A reason; false in a condition when there is nothing to explain."""

    code: ReasonCode = ReasonCode.NONE
    sensors: tuple[str, ...] = ()  #: of ``fsw_control.contract.SENSORS``, where it is about sensors
    limit_s: float = 0.0  #: time that was exceeded
    detail: str = ""  #: for people: an error, a status or a state in words

    def __bool__(self) -> bool:
        return self.code is not ReasonCode.NONE

    @property
    def words(self) -> str:
        """The reason in words; empty when there is nothing to explain."""
        return _WORDS[self.code].format(sensors=", ".join(self.sensors), limit_s=self.limit_s, detail=self.detail)

    @property
    def fields(self) -> dict[str, Any]:
        """The fields of ``Reason.msg``."""
        return {"code": int(self.code), "sensors": list(self.sensors), "limit": self.limit_s, "detail": self.detail}

    @classmethod
    def of(cls, given: Reason | str) -> Reason:
        """A reason from what a controller gave, which may be words of its own."""
        if isinstance(given, Reason):
            return given
        return cls(ReasonCode.OTHER, detail=given) if given else cls()
