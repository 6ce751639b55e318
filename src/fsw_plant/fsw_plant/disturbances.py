"""Disturbances: a shape over time on one of the plant's channels."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi, sin

#: Channels and their units: the first two are added to outputs, the others to inputs.
CHANNELS = {"depth": "mm", "temperature": "c", "axial_force": "kn", "spindle_speed": "rpm"}
OUTPUT_CHANNELS = ("depth", "temperature")
SHAPES = ("step", "ramp", "sine", "pulse", "none")


class DisturbanceError(ValueError):
    """A disturbance or fault that does not exist or makes no sense; the message says what is allowed."""


def positive_or_zero(value: float, name: str) -> float:
    """Return ``value`` if it is finite and not negative, else raise `DisturbanceError`."""
    if not isfinite(value) or value < 0:
        raise DisturbanceError(f"{name} is {value!r}: give a finite number >= 0")
    return value


@dataclass(frozen=True, slots=True)
class Disturbance:
    """A shape over time.

    Attributes
    ----------
    shape : str
        ``step``: amplitude from now on; ``ramp``: rises to the amplitude over ``duration_s`` and stays; ``sine``: for
        ``duration_s`` or, if that is 0, until cleared; ``pulse``: amplitude for ``duration_s``, then nothing.
    amplitude : float
        In the channel's unit.
    duration_s, period_s : float
        See ``shape``; ``period_s`` is the sine's.
    start_s : float
        Time at which it begins.

    Raises
    ------
    DisturbanceError
        If the shape is unknown, a number is not finite, or the shape lacks its duration or period.
    """

    shape: str
    amplitude: float
    duration_s: float = 0.0
    period_s: float = 0.0
    start_s: float = 0.0

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise DisturbanceError(f"disturbance shape {self.shape!r} is none of {', '.join(SHAPES)}")
        if not isfinite(self.amplitude):
            raise DisturbanceError(f"disturbance amplitude is {self.amplitude!r}: give a finite number")
        positive_or_zero(self.duration_s, "disturbance duration_s")
        positive_or_zero(self.period_s, "disturbance period_s")
        if self.shape in ("ramp", "pulse") and self.duration_s == 0:
            raise DisturbanceError(f"disturbance shape {self.shape} needs duration_s > 0")
        if self.shape == "sine" and self.period_s == 0:
            raise DisturbanceError("disturbance shape sine needs period_s > 0")

    def value(self, time_s: float) -> float:
        """Value at a time, in the channel's unit."""
        since = time_s - self.start_s
        if since < -1e-9 or self.shape == "none":
            return 0.0
        if self.shape == "step":
            return self.amplitude
        if self.shape == "ramp":
            return self.amplitude * min(since / self.duration_s, 1.0)
        if self.over(time_s):
            return 0.0
        return self.amplitude if self.shape == "pulse" else self.amplitude * sin(2.0 * pi * since / self.period_s)

    def over(self, time_s: float) -> bool:
        """Whether it has ended by itself."""
        ends = self.shape in ("pulse", "sine") and self.duration_s > 0.0
        return ends and time_s - self.start_s > self.duration_s - 1e-9


class Disturbances:
    """The disturbance of each channel; a channel carries one at a time."""

    def __init__(self) -> None:
        self._active: dict[str, Disturbance] = {}

    def __bool__(self) -> bool:
        return bool(self._active)

    def set(self, channel: str, disturbance: Disturbance) -> None:
        """Put a disturbance on a channel in place of what is there.

        Raises
        ------
        DisturbanceError
            If the channel is unknown.
        """
        if channel not in CHANNELS:
            raise DisturbanceError(f"disturbance channel {channel!r} is none of {', '.join(CHANNELS)}")
        if disturbance.shape == "none":
            self._active.pop(channel, None)
        else:
            self._active[channel] = disturbance

    def value(self, channel: str, time_s: float) -> float:
        """Value on a channel at a time, in its unit."""
        disturbance = self._active.get(channel)
        return 0.0 if disturbance is None else disturbance.value(time_s)

    def names(self, time_s: float) -> list[str]:
        """Disturbances that are not over at a time, e.g. ``depth:step``."""
        return [f"{channel}:{each.shape}" for channel, each in self._active.items() if not each.over(time_s)]

    def clear(self) -> None:
        """Remove all."""
        self._active.clear()
