"""Whether a controller may be selected, and the missing condition."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple, Self

from fsw_control.reason import Reason


class Lack(IntEnum):
    """Conditions that prevent a selection; numbered as in ``ControllerHealth.msg``.

    Members are ``NAME = number, predicate, explanation``: texts about the controller.
    """

    predicate: str
    why: str

    def __new__(cls, value: int, predicate: str = "", why: str = "") -> Self:
        """Create a member with its texts."""
        lack = int.__new__(cls, value)
        lack._value_, lack.predicate, lack.why = value, predicate, why
        return lack

    NONE = 0
    UNKNOWN = 1, "", "is unknown"
    INHIBITED = 2, "is inhibited: ", "{why}"
    AMBIGUOUS = 3, "is ambiguous: ", "two controllers of this name propose"
    UNUSABLE = 4, "is not usable: ", "{why}"
    LEFT = 5, "", "has left the graph"
    WARMING = 6, "is not ready: ", "{good} of {required} good proposals in a row"
    BLIND = 7, "", "requires the sensor {sensors}"

    @classmethod
    def _missing_(cls, value: object) -> Lack:
        return cls.UNUSABLE


class Readiness(NamedTuple):
    """What a controller lacks: nothing, if it may be selected."""

    lack: Lack = Lack.NONE
    reason: Reason = Reason()  #: if inhibited or unusable
    sensors: tuple[str, ...] = ()  #: that it requires, if blind
    good: int = 0  #: good proposals in a row
    required: int = 0  #: good proposals in a row for it to be ready

    @property
    def why(self) -> str:
        """What it lacks, in words without its name; empty if nothing."""
        sensors = ", ".join(self.sensors)
        return self.lack.why.format(
            why=self.reason.words, sensors=sensors, good=self.good, required=self.required
        )

    @property
    def predicate(self) -> str:
        """The same as the predicate of a sentence about it."""
        return self.lack.predicate + self.why

    def words(self, name: str) -> str:
        """What controller ``name`` lacks; empty if nothing."""
        return "" if self.lack is Lack.NONE else f"{name} {self.predicate}"
