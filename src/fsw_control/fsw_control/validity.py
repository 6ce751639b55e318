"""Whether a sensor's samples may be used: finite, in range, not too fast, not frozen, not missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from fsw_control.contract import SENSORS, Command, Measurement

#: probability at which a run of equal samples is no longer believed to be chance
_CHANCE = 1e-9
#: relative difference of samples that are equal but for rounding, as a simulation without noise has them
_ROUNDING = 1e-9
#: share of reversals of direction above which a signal counts as noisy (white noise: 2/3, a smooth signal: ~0)
_NOISY = 0.25


@dataclass(frozen=True, slots=True)
class SensorLimits:
    """What one sensor may show; values in the sensor's unit (mm, N m, degC).

    Attributes
    ----------
    minimum, maximum : float
        Plausible range, inclusive.
    max_rate : float
        Largest change per second against the last good sample. A larger one is a spike, unless
        ``confirm_samples`` samples in a row agree with each other.
    hold_s : float
        The last good value stands in for bad samples so long; then the sensor is invalid.
    frozen_samples : int
        So many equal samples in a row are at least needed to call a sensor frozen; 0 never calls it so.
    confirm_samples : int
        See ``max_rate``; also the good samples needed to become valid again.
    """

    minimum: float
    maximum: float
    max_rate: float
    hold_s: float = 0.3
    frozen_samples: int = 10
    confirm_samples: int = 3

    def __post_init__(self) -> None:
        if not self.minimum < self.maximum:
            raise ValueError(f"minimum {self.minimum} must be below maximum {self.maximum}")
        if not self.max_rate > 0.0 or self.hold_s < 0.0 or self.frozen_samples < 0 or self.confirm_samples < 1:
            raise ValueError("max_rate and confirm_samples must be positive, hold_s and frozen_samples not negative")


#: Chosen: wide enough for every step, disturbance and inertia spike of the experiments.
DEFAULT_LIMITS = {
    "depth": SensorLimits(0.0, 6.0, 10.0),
    "torque": SensorLimits(100.0, 3000.0, 3000.0),
    "thermocouple": SensorLimits(300.0, 1080.0, 400.0),
}


def sensor_limits(values: Mapping[str, Any]) -> dict[str, SensorLimits]:
    """Limits of all sensors from a node's parameters ``validity.*``.

    Raises
    ------
    ValueError
        When they contradict each other; the message says which.
    """
    return {
        sensor: SensorLimits(
            minimum=values[f"validity.{sensor}.minimum"],
            maximum=values[f"validity.{sensor}.maximum"],
            max_rate=values[f"validity.{sensor}.max_rate"],
            hold_s=values["validity.hold"],
            frozen_samples=values["validity.frozen_samples"],
            confirm_samples=values["validity.confirm_samples"],
        )
        for sensor in SENSORS
    }


class Reading(NamedTuple):
    """A sensor at one tick: the value to use (NaN if invalid) and, unless all is well, why not.

    ``held``: the value is the last good one, not a measurement of this tick.
    """

    value: float
    valid: bool
    reason: str = ""
    held: bool = False


class Frozen:
    """Tells a frozen sensor from one whose quantised or noise-free signal happens to stand still.

    A run of equal samples is suspicious only where the signal was noisy before, and only when the run is
    longer than the share of equal neighbours seen before makes likely.

    Parameters
    ----------
    samples : int
        Shortest run to call frozen; 0 switches the test off.
    memory : int
        Samples over which the noise and the share of equal neighbours are averaged.
    """

    __slots__ = ("_count", "_equal", "_last", "_memory", "_reversed", "_rising", "run", "samples")

    def __init__(self, samples: int, memory: int = 150) -> None:
        self.samples = samples
        self.run = 0
        self._memory = memory
        self._last = math.nan
        self._rising = False
        self._count = 0
        self._equal = 0.0
        self._reversed = 0.0

    def update(self, value: float) -> bool:
        """Take the next sample; return whether the sensor is frozen."""
        if abs(value - self._last) <= _ROUNDING * abs(value):
            self.run += 1
            return self.run >= self.samples - 1 and self._is_frozen()
        # A run of equal samples is remembered only once it has ended, and not if it was a freeze:
        # a freeze must not teach that standing still is normal.
        if self.run:
            if not (self.run >= self.samples - 1 and self._is_frozen()):
                for _ in range(min(self.run, self._memory)):
                    self._equal += (1.0 - self._equal) * self._weight()
            self.run = 0
        rising = value > self._last
        if self._last == self._last:
            weight = self._weight()
            self._equal -= self._equal * weight
            self._reversed += ((rising != self._rising) - self._reversed) * weight
        self._rising, self._last = rising, value
        return False

    def _weight(self) -> float:
        if self._count < self._memory:
            self._count += 1
        return 1.0 / self._count

    def _is_frozen(self) -> bool:
        if not self.samples or self._count < 20 or self._reversed < _NOISY:
            return False
        # three standard deviations up, because the share was estimated from few samples
        likely = max(self._equal, 1.0 / self._count)
        share = min(likely + 3.0 * math.sqrt(likely * (1.0 - likely) / (2.0 * self._count)), 0.95)
        return self.run >= math.log(_CHANCE) / math.log(share)


class SensorValidity:
    """Judges one sensor, sample by sample.

    Parameters
    ----------
    limits : SensorLimits
        What the sensor may show.
    """

    def __init__(self, limits: SensorLimits) -> None:
        self.limits = limits
        self._frozen = Frozen(limits.frozen_samples)
        self._good = math.nan
        self._good_s = -math.inf
        self._candidate = math.nan
        self._candidate_s = -math.inf
        self._agreeing = 0
        self._valid = False

    def configure(self, limits: SensorLimits) -> None:
        """Judge by other limits from now on, without forgetting."""
        self.limits = limits
        self._frozen.samples = limits.frozen_samples

    def update(self, time_s: float, value: float | None) -> Reading:
        """Judge the sample of the tick at ``time_s``; None says that none came."""
        fault = self._fault(value)
        if fault:
            self._agreeing = 0
        elif value is not None:
            fault = self._jump(time_s, value)
        if not fault and value is not None:
            self._good, self._good_s, self._valid = value, time_s, True
            return Reading(value, True)
        if self._valid and fault != "frozen" and time_s - self._good_s <= self.limits.hold_s + 1e-9:
            return Reading(self._good, True, f"{fault}, held", held=True)
        self._valid = False
        return Reading(math.nan, False, fault)

    def _fault(self, value: float | None) -> str:
        if value is None:
            return "missing"
        if not math.isfinite(value):
            return "not finite"
        frozen = self._frozen.update(value)
        if not self.limits.minimum <= value <= self.limits.maximum:
            return "out of range"
        return "frozen" if frozen else ""

    def _jump(self, time_s: float, value: float) -> str:
        """Refuse a change that is too fast, until enough samples in a row agree that it is real."""
        if not math.isfinite(self._good):
            return ""
        if self._valid and self._near(value, self._good, time_s - self._good_s):
            self._agreeing = 0
            return ""
        agrees = self._agreeing and self._near(value, self._candidate, time_s - self._candidate_s)
        self._agreeing = self._agreeing + 1 if agrees else 1
        self._candidate, self._candidate_s = value, time_s
        if self._agreeing >= self.limits.confirm_samples:
            self._agreeing = 0
            return ""
        return "too fast" if self._valid else "recovering"

    def _near(self, value: float, other: float, elapsed_s: float) -> bool:
        return abs(value - other) <= self.limits.max_rate * max(elapsed_s, 0.05)


@dataclass(slots=True)
class SensorGuard:
    """Judges the three sensors of a tick together.

    Attributes
    ----------
    reasons : dict of str to str
        By sensor, why its last sample was not used; empty where it was.
    """

    limits: dict[str, SensorLimits] = field(default_factory=lambda: dict(DEFAULT_LIMITS))
    reasons: dict[str, str] = field(default_factory=lambda: dict.fromkeys(SENSORS, ""))
    _sensors: dict[str, SensorValidity] = field(init=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the past, as at a restart of time."""
        self._sensors = {name: SensorValidity(self.limits[name]) for name in SENSORS}

    def configure(self, limits: dict[str, SensorLimits]) -> None:
        """Judge by other limits from now on, without forgetting."""
        self.limits = limits
        for name, sensor in self._sensors.items():
            sensor.configure(limits[name])

    def measure(self, time_s: float, values: dict[str, float], drives: Command | None = None) -> Measurement:
        """Return the measurement of a tick.

        Parameters
        ----------
        time_s : float
            Stamp of the tick.
        values : dict of str to float
            Sample by sensor name (mm, N m, degC); absent where none came.
        drives : Command, optional
            Force and speed that act, as the drives report them at this tick.
        """
        depth, torque, temperature = readings = [
            self._sensors[name].update(time_s, values.get(name)) for name in SENSORS
        ]
        self.reasons.update(zip(SENSORS, (reading.reason for reading in readings), strict=True))
        return Measurement(
            time_s,
            depth.value,
            torque.value,
            temperature.value,
            depth.valid,
            torque.valid,
            temperature.valid,
            held=tuple(name for name, reading in zip(SENSORS, readings, strict=True) if reading.held),
            force_kn=math.nan if drives is None else drives.force_kn,
            speed_rpm=math.nan if drives is None else drives.speed_rpm,
        )
