"""What the monitor finds: causes as codes with sizes, and, for people, their words from one table."""

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


class Judged(Worded):
    """What a finding is, for people; a trend is no alarm."""

    ALARM = "alarm", "{cause.words}"
    ALARM_OR = "alarm_or", "{cause.words}; or, which cannot be distinguished: {others}"
    TREND = "trend", "no alarm: {cause.words}"
    TREND_OR = "trend_or", "no alarm: {cause.words}; or, which cannot be distinguished: {others}"


#: causes by which a sensor's values mean nothing
_SICK = {one for one in WatchCause if one.name.endswith(("_STUCK", "_NOISE_GONE", "_DETACHED"))}


@dataclass(frozen=True, slots=True)
class Finding:
    """An alarm, or something that is shown and is none: a trend, a command at its limit."""

    cause: WatchCause
    alarm: bool = True
    size: float = nan  #: in paper's units and seconds, see ``monitor_texts.yaml``
    error: float = nan  #: standard error of the size
    #: smoothed log likelihood ratio of this cause (of the process, else NaN) to the largest of it that
    #: is no alarm, of a trend to the largest that is none
    log_likelihood: float = nan
    #: causes that explain the same nearly as well, the likeliest first
    others: tuple[WatchCause, ...] = ()

    @property
    def of_sensor(self) -> bool:
        """Whether a sensor's values mean nothing, so that what is computed from them is wrong, too."""
        return self.cause in _SICK

    @property
    def fact(self) -> Fact:
        """The finding as a code with its cause, size [SI] and what cannot be distinguished from it."""
        text, (size, error) = _TEXTS[self.cause.word], self.si
        shown = f"{text.factor * self.size:{text.digits}}"
        if isfinite(self.error):
            shown += f" ± {2.0 * text.factor * self.error:{text.digits.lstrip('+')}}"
        cause = Fact.of(_CAUSES[self.cause.name], shown=shown, size=size, error=error)
        code = Judged.ALARM if self.alarm else Judged.TREND
        if not self.others:
            return Fact.of(code, cause=cause)
        others = tuple(Fact.of(_NAMES[one.name]) for one in self.others)
        return Fact.of(Judged[f"{code.name}_OR"], cause=cause, others=others)

    @property
    def text(self) -> str:
        """The finding in words."""
        return self.fact.words

    @property
    def action(self) -> str:
        """Code of what to do, in ``ACTIONS``."""
        return _TEXTS[self.cause.word].action

    @property
    def si(self) -> tuple[float, float]:
        """Size and error in SI units."""
        factor = _TEXTS[self.cause.word].si
        return factor * self.size, factor * self.error


class _Text(Model):
    name: str
    cause: str
    action: str
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
