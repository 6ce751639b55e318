"""Sensor faults: what happens to a sample between sensor and wire."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import NamedTuple

from fsw_control import SENSORS
from fsw_plant.disturbances import DisturbanceError, positive_or_zero

KINDS = ("freeze", "dropout", "nan", "spike", "bias", "drift", "delay", "duplicate", "none")
#: Longest ``delay``, so that the samples under way stay few.
MAX_DELAY_S = 60.0
#: Ticks from one spike to the next.
SPIKE_TICKS = 10


class Sample(NamedTuple):
    """What a sensor reports: the stamp of its tick and the value in the sensor's unit."""

    stamp_ns: int
    value: float


@dataclass(slots=True)
class Fault:
    """A fault of one sensor.

    Attributes
    ----------
    kind : str
        ``freeze``: the value stays, the stamp goes on; ``dropout``: nothing is sent; ``nan``: NaN is sent; ``spike``:
        the magnitude is added to one sample, and with a duration to one sample a second; ``bias``: the magnitude is
        added; ``drift``: magnitude per second is added; ``delay``: samples come ``magnitude`` seconds late, with the
        stamp they were taken at (those under way when the fault ends are lost); ``duplicate``: each is sent twice.
    magnitude : float
        See ``kind``: in the sensor's unit (mm, N m, degC), per second for a drift, in s for a delay.
    duration_s : float
        0: until cleared (a spike: one sample).
    start_s : float
        Time at which it begins.

    Raises
    ------
    DisturbanceError
        If the kind is unknown or a number makes no sense.
    """

    kind: str
    magnitude: float = 0.0
    duration_s: float = 0.0
    start_s: float = 0.0
    _last: float | None = field(default=None, repr=False)
    _ticks: int = field(default=0, repr=False)
    _under_way: deque[tuple[float, Sample]] = field(default_factory=deque, repr=False)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise DisturbanceError(f"fault kind {self.kind!r} is none of {', '.join(KINDS)}")
        if not isfinite(self.magnitude):
            raise DisturbanceError(f"fault magnitude is {self.magnitude!r}: give a finite number")
        positive_or_zero(self.duration_s, "fault duration_s")
        if self.kind == "delay" and not 0.0 <= self.magnitude <= MAX_DELAY_S:
            raise DisturbanceError(f"delay is {self.magnitude!r} s: must be 0 to {MAX_DELAY_S:g} s")

    def over(self, time_s: float) -> bool:
        """Whether the fault has ended by itself."""
        if self.kind == "spike" and self.duration_s == 0.0:
            return self._ticks > 0
        return self.duration_s > 0.0 and time_s > self.start_s + self.duration_s - 1e-9

    def pass_on(self, sample: Sample, time_s: float, last: float | None) -> tuple[Sample, ...]:
        """What is sent at this tick instead of ``sample``.

        Parameters
        ----------
        sample : Sample
            What the healthy sensor says.
        time_s : float
            Time of the tick.
        last : float or None
            Value that the sensor sent last before this fault.
        """
        tick, self._ticks = self._ticks, self._ticks + 1
        if self.kind == "dropout":
            return ()
        if self.kind == "nan":
            return (Sample(sample.stamp_ns, nan),)
        if self.kind == "duplicate":
            return (sample, sample)
        if self.kind == "freeze":
            if self._last is None:
                self._last = sample.value if last is None else last
            return (Sample(sample.stamp_ns, self._last),)
        if self.kind == "delay":
            self._under_way.append((time_s + self.magnitude, sample))
            arrived: list[Sample] = []
            while self._under_way and self._under_way[0][0] <= time_s + 1e-9:
                arrived.append(self._under_way.popleft()[1])
            return tuple(arrived)
        return (Sample(sample.stamp_ns, sample.value + self._offset(tick, time_s)),)

    def _offset(self, tick: int, time_s: float) -> float:
        if self.kind == "bias":
            return self.magnitude
        if self.kind == "drift":
            return self.magnitude * (time_s - self.start_s)
        return self.magnitude if tick % SPIKE_TICKS == 0 else 0.0


class Faults:
    """The fault of each sensor; a sensor has one at a time."""

    def __init__(self) -> None:
        self._active: dict[str, Fault] = {}
        self._sent: dict[str, float] = {}

    def __bool__(self) -> bool:
        return bool(self._active)

    def set(self, sensor: str, fault: Fault) -> None:
        """Give a sensor a fault in place of the one it has.

        Raises
        ------
        DisturbanceError
            If the sensor is unknown.
        """
        if sensor not in SENSORS:
            raise DisturbanceError(f"sensor {sensor!r} is none of {', '.join(SENSORS)}")
        if fault.kind == "none":
            self._active.pop(sensor, None)
        else:
            self._active[sensor] = fault

    def pass_on(self, sensor: str, sample: Sample, time_s: float, last: float | None) -> tuple[Sample, ...]:
        """What the sensor sends at this tick, see :meth:`Fault.pass_on`."""
        fault = self._active.get(sensor)
        if fault is not None and fault.over(time_s):
            del self._active[sensor]
            fault = None
        return (sample,) if fault is None else fault.pass_on(sample, time_s, last)

    def names(self) -> list[str]:
        """Active faults, e.g. ``thermocouple:freeze``."""
        return [f"{sensor}:{fault.kind}" for sensor, fault in self._active.items()]

    def clear(self) -> None:
        """Remove all."""
        self._active.clear()
