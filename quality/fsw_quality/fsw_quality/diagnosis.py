"""What the monitor finds.

Causes as codes with sizes, and, for people, their words from one table.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from math import isfinite, nan
from typing import Any

from fsw_control.coded import Coded, Fact, Worded
from fsw_control.schema.models import Model
from fsw_control.schema.yaml_text import load_yaml


class WatchCause(Coded):
    """What may be wrong in a weld; numbered as in ``WeldFinding.msg``."""

    NONE = 0
    DEPTH_STUCK = 1
    TORQUE_STUCK = 2
    THERMOCOUPLE_STUCK = 3
    DEPTH_SPIKES = 4
    TORQUE_SPIKES = 5
    THERMOCOUPLE_SPIKES = 6
    DEPTH_NOISE_GROWN = 7
    TORQUE_NOISE_GROWN = 8
    THERMOCOUPLE_NOISE_GROWN = 9
    DEPTH_NOISE_GONE = 10
    TORQUE_NOISE_GONE = 11
    THERMOCOUPLE_NOISE_GONE = 12
    THERMOCOUPLE_DETACHED = 13
    FORCE_STICKS = 20
    SPEED_STICKS = 21
    FORCE_LAGS = 22
    SPEED_LAGS = 23
    FORCE_SATURATED = 24
    SPEED_SATURATED = 25
    THERMOCOUPLE_DRIFT = 40
    DEPTH_DRIFT = 41
    LOAD_CELL_STEP = 42
    TORQUE_DRIFT = 43
    TORQUE_STEP = 44
    TOOL_WEAR = 45
    TORQUE_GAIN = 46
    DEPTH_GAIN = 47
    HEAT_GAIN = 48
    DEAD_TIME = 49
    #: none that this version knows
    UNKNOWN = 255

    @property
    def of_process(self) -> bool:
        """Whether residuals of the model show it."""
        return 40 <= self < 60


class NotJudged(Coded):
    """Why the size of a fault is not estimated; numbered as in ``WeldEstimate.msg``."""

    NONE = 0
    #: the disturbances of the weld are still being learnt
    LEARNING = 1
    #: of the heat, on a canister
    HEAT_UNKNOWN = 2
    UNKNOWN = 255


class Judged(Worded):
    """What a finding is, for people."""

    ALARM = "{cause.words}"
    ALARM_OR = "{cause.words}; or, which cannot be distinguished: {others}"
    SHOWN = "no alarm: {cause.words}"


#: causes by which a sensor's values mean nothing
_SICK = {
    cause for cause in WatchCause if cause.name.endswith(("_STUCK", "_NOISE_GONE", "_DETACHED"))
}


@dataclass(frozen=True, slots=True)
class Finding:
    """An alarm, or something that is shown and is none: a command at its limit."""

    cause: WatchCause
    alarm: bool = True
    size: float = nan  #: in paper's units and seconds, see ``monitor_texts.yaml``
    error: float = nan  #: standard error of the size
    #: smoothed log likelihood ratio of this cause (of the process, else NaN) to the largest of it
    #: that does no harm
    log_likelihood: float = nan
    #: causes that explain the same nearly as well, the likeliest first
    others: tuple[WatchCause, ...] = ()

    @property
    def of_sensor(self) -> bool:
        """Whether a sensor's values mean nothing, so that figures computed from them are wrong."""
        return self.cause in _SICK

    @property
    def fact(self) -> Fact:
        """The finding as a code with its cause, size [SI] and indistinguishable causes."""
        size, error = self.si
        shown = _shown(self.cause, self.size, self.error)
        cause = Fact.of(_CAUSES[self.cause.name], shown=shown, size=size, error=error)
        if not self.others:
            return Fact.of(Judged.ALARM if self.alarm else Judged.SHOWN, cause=cause)
        others = tuple(Fact.of(_NAMES[cause.name]) for cause in self.others)
        return Fact.of(Judged.ALARM_OR, cause=cause, others=others)

    @property
    def text(self) -> str:
        """The finding in words."""
        return self.fact.words

    @property
    def action(self) -> str:
        """Code of what to do, in ``ACTIONS``."""
        return _TEXTS[self.cause.word].action

    @property
    def unit(self) -> str:
        """Unit in which people read the size; empty of a number of spikes."""
        return _TEXTS[self.cause.word].unit

    @property
    def scaled(self) -> tuple[float, float]:
        """Size and its standard error in that unit."""
        factor = _TEXTS[self.cause.word].factor
        return factor * self.size, factor * self.error

    @property
    def si(self) -> tuple[float, float]:
        """Size and error in SI units."""
        factor = _TEXTS[self.cause.word].si
        return factor * self.size, factor * self.error


@dataclass(frozen=True, slots=True)
class Estimate:
    """How large a fault is if it alone has been there for a minute or longer.

    No claim that there is one.
    """

    cause: WatchCause
    size: float = nan  #: in paper's units and seconds, as of a finding
    error: float = nan  #: standard error of the size
    #: smallest size that is expected to be an alarm a minute after its begin; infinite: none
    alarm_size: float = nan
    reason: NotJudged = NotJudged.NONE

    @classmethod
    def of_si(cls, cause: WatchCause, reason: NotJudged, **sizes: float) -> Estimate:
        """Return the estimate of these sizes in SI units, as in :attr:`si`."""
        factor = _TEXTS[cause.word].si
        return cls(cause, reason=reason, **{name: size / factor for name, size in sizes.items()})

    @property
    def is_distinct(self) -> bool:
        """Whether the size differs from 0 by more than two standard errors."""
        return abs(self.size) > 2.0 * self.error

    @property
    def name(self) -> str:
        """Name of the fault."""
        return _TEXTS[self.cause.word].name

    @property
    def unit(self) -> str:
        """Unit in which people read the size."""
        return _TEXTS[self.cause.word].unit

    @property
    def scaled(self) -> tuple[float, float, float]:
        """Size, its standard error and the smallest size of an alarm in that unit."""
        factor = _TEXTS[self.cause.word].factor
        return factor * self.size, factor * self.error, factor * self.alarm_size

    @property
    def si(self) -> dict[str, float]:
        """The same by name, in SI units."""
        factor = _TEXTS[self.cause.word].si
        sizes = {"size": self.size, "error": self.error, "alarm_size": self.alarm_size}
        return {name: factor * value for name, value in sizes.items()}

    @property
    def text(self) -> str:
        """The estimate with twice its standard error, or why there is none, in words."""
        if self.reason:
            return f"not judged: {self.reason.word.replace('_', ' ')}"
        return _shown(self.cause, self.size, self.error)

    @property
    def alarm_text(self) -> str:
        """The smallest size of an alarm in words."""
        text = _TEXTS[self.cause.word]
        if not isfinite(self.alarm_size):
            return "no size" if self.alarm_size > 0.0 else ""
        return f"{text.factor * self.alarm_size:{text.digits.lstrip('+')}} {text.unit}"

    @property
    def numbers(self) -> dict[str, Any]:
        """The estimate by name, ready for JSON; without a size where nothing would be an alarm."""
        if self.reason:
            return {"not_judged": self.reason.word}
        size, error, alarm_size = self.scaled
        alarm = {"alarm_size": alarm_size if isfinite(alarm_size) else None}
        return {"size": size, "standard_error": error, **alarm, "unit": self.unit}


def _shown(cause: WatchCause, size: float, error: float) -> str:
    text = _TEXTS[cause.word]
    # z: no sign of a size that is rounded to 0
    shown = f"{text.factor * size:{text.digits.replace('.', 'z.')}}"
    if isfinite(error):
        shown += f" ± {2.0 * text.factor * error:{text.digits.lstrip('+')}}"
    return f"{shown} {text.unit}".rstrip()


class _Text(Model):
    name: str
    cause: str
    action: str
    unit: str = ""
    """behind a size"""
    factor: float = 1.0
    """from the paper's unit, per second, to that of the text"""
    si: float = 1.0
    """from the paper's unit to SI"""
    digits: str = ".1f"
    """how a size is written"""


_TEXTS = {
    name: _Text.model_validate(entry)
    for name, entry in load_yaml(
        files("fsw_quality").joinpath("monitor_texts.yaml").read_text("utf-8")
    ).items()
}


def _codes(words: str) -> dict[str, Worded]:
    """Codes of the causes with one of their texts from that table, by name."""
    enum: Any = Worded  # a call makes another enum, whose members differ
    texts = {name.upper(): (name, getattr(text, words)) for name, text in _TEXTS.items()}
    return dict(enum("Cause", texts).__members__)


_CAUSES, _NAMES = _codes("cause"), _codes("name")
