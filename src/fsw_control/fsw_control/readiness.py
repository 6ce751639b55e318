"""Whether a controller may be selected, and the missing condition."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from fsw_control.reason import Reason


class Lack(IntEnum):
    """Conditions that prevent a selection; numbered as in ``ControllerHealth.msg``."""

    NONE = 0
    UNKNOWN = 1
    INHIBITED = 2
    AMBIGUOUS = 3
    UNUSABLE = 4
    LEFT = 5
    WARMING = 6
    BLIND = 7

    @classmethod
    def _missing_(cls, value: object) -> Lack:
        return cls.UNUSABLE


#: text about the controller, and its explanation
_WORDS = {
    Lack.UNKNOWN: ("", "is unknown"),
    Lack.INHIBITED: ("is inhibited: ", "{why}"),
    Lack.AMBIGUOUS: ("is ambiguous: ", "two controllers of this name propose"),
    Lack.UNUSABLE: ("is not usable: ", "{why}"),
    Lack.LEFT: ("", "has left the graph"),
    Lack.WARMING: ("is not ready: ", "{good} of {required} good proposals in a row"),
    Lack.BLIND: ("", "requires the sensor {sensors}"),
}


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
        if self.lack is Lack.NONE:
            return ""
        sensors = ", ".join(self.sensors)
        return _WORDS[self.lack][1].format(
            why=self.reason.words, sensors=sensors, good=self.good, required=self.required
        )

    @property
    def predicate(self) -> str:
        """The same as the predicate of a sentence about it."""
        return "" if self.lack is Lack.NONE else f"{_WORDS[self.lack][0]}{self.why}"

    def words(self, name: str) -> str:
        """What controller ``name`` lacks; empty if nothing."""
        return "" if self.lack is Lack.NONE else f"{name} {self.predicate}"
