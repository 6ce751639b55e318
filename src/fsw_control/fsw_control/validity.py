"""Whether a sensor's samples may be used: finite, in range, not too fast, not frozen, not missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from fsw_control.contract import SENSORS, Command, Measurement
from fsw_control.parameters import defaults, load

#: probability at which a run of equal samples is no longer taken for chance
_CHANCE = 1e-9
#: relative difference of samples that are equal but for rounding, as a simulation without noise has them
_ROUNDING = 1e-9
#: share of reversals of direction above which a signal counts as noisy (white noise: 2/3, a smooth signal: ~0)
_NOISY = 0.25
#: samples before which no sensor is judged to be frozen
_LEARNT = 20
#: largest share of equal neighbours that is assumed
_LARGEST_SHARE = 0.95
#: standard deviations added to that share, because it was estimated from few samples
_DEVIATIONS = 3.0
#: changes are judged as if at least this time had passed, because stamps jitter [s]
_LEAST_ELAPSED_S = 0.05
#: samples over which the noise and the share of equal neighbours are averaged
_MEMORY = 150


@dataclass(frozen=True, slots=True)
class SensorLimits:
    """Limits of one sensor, in its unit (mm, N m, degC); see the parameters ``validity.*`` in ``controller.yaml``.

    A change faster than ``max_rate`` against the last good sample is a spike, unless ``confirm_samples`` samples in a
    row agree with each other. As many are needed to become valid again.
    """

    minimum: float
    maximum: float
    max_rate: float
    hold_s: float
    frozen_samples: int
    confirm_samples: int


def sensor_limits(values: Mapping[str, Any] | None = None) -> dict[str, SensorLimits]:
    """Limits of all sensors from a node's parameters ``validity.*``; by default those of ``controller.yaml``.

    Raises
    ------
    ValueError
        When they contradict each other; the message names the sensor.
    """
    if values is None:
        values = defaults(load("fsw_control", "controller.yaml"))
    limits = {
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
    for sensor, one in limits.items():
        if not one.minimum < one.maximum:
            raise ValueError(f"validity.{sensor}: minimum {one.minimum} must be below maximum {one.maximum}")
    return limits


class Reading(NamedTuple):
    """A sensor at one tick: the value to use (NaN if invalid) and, unless all is well, why not.

    ``held``: the value is the last good one, not a measurement of this tick.
    """

    value: float
    valid: bool
    reason: str = ""
    held: bool = False


class Frozen:
    """Distinguishes a frozen sensor from one whose quantised or noise-free signal happens to stand still.

    A run of equal samples is suspicious only where the signal was noisy before, and only when the run is
    longer than the share of equal neighbours seen before makes likely.
    """

    def __init__(self) -> None:
        self._run = 0
        self._last = math.nan
        self._rising = False
        self._count = 0
        self._equal = 0.0
        self._reversed = 0.0

    def update(self, value: float, samples: int) -> bool:
        """Take the next sample; return whether the sensor is frozen, after a run of ``samples`` at least (0: never)."""
        last = self._last
        if abs(value - last) <= _ROUNDING * abs(value):
            self._run += 1
            return self._is_frozen(samples)
        # A run of equal samples is remembered only once it has ended, and not if it was a freeze:
        # a freeze must not count as a normal standstill.
        if self._run:
            if not self._is_frozen(samples):
                for _ in range(min(self._run, _MEMORY)):
                    self._equal += (1.0 - self._equal) * self._weight()
            self._run = 0
        rising = value > last
        if last == last:  # not the first sample
            weight = self._weight()
            self._equal -= self._equal * weight
            self._reversed += ((rising != self._rising) - self._reversed) * weight
        self._rising, self._last = rising, value
        return False

    def _weight(self) -> float:
        if self._count < _MEMORY:
            self._count += 1
        return 1.0 / self._count

    def _is_frozen(self, samples: int) -> bool:
        if not samples or self._run < samples - 1 or self._count < _LEARNT or self._reversed < _NOISY:
            return False
        likely = max(self._equal, 1.0 / self._count)
        deviation = math.sqrt(likely * (1.0 - likely) / (2.0 * self._count))
        share = min(likely + _DEVIATIONS * deviation, _LARGEST_SHARE)
        return self._run >= math.log(_CHANCE) / math.log(share)


class SensorValidity:
    """Judges one sensor, sample by sample; ``limits`` may be replaced at any time."""

    def __init__(self, limits: SensorLimits) -> None:
        self.limits = limits
        self._frozen = Frozen()
        self._good = math.nan
        self._good_s = -math.inf
        self._candidate = math.nan
        self._candidate_s = -math.inf
        self._agreeing = 0
        self._valid = False

    def update(self, time_s: float, value: float | None) -> Reading:
        """Judge the sample of the tick at ``time_s``; None: none came."""
        limits = self.limits
        if value is None:
            fault = "missing"
        elif not math.isfinite(value):
            fault = "not finite"
        else:
            frozen = self._frozen.update(value, limits.frozen_samples)
            if not limits.minimum <= value <= limits.maximum:
                fault = "out of range"
            elif frozen:
                fault = "frozen"
            elif not (
                self._valid
                and abs(value - self._good) <= limits.max_rate * max(time_s - self._good_s, _LEAST_ELAPSED_S)
            ) and self._jumps(time_s, value):
                fault = "too fast" if self._valid else "recovering"
            else:
                self._agreeing = 0
                self._good, self._good_s, self._valid = value, time_s, True
                return Reading(value, True)
        if fault not in ("too fast", "recovering"):
            self._agreeing = 0
        if self._valid and fault != "frozen" and time_s - self._good_s <= limits.hold_s + 1e-9:
            return Reading(self._good, True, f"{fault}, held", held=True)
        self._valid = False
        return Reading(math.nan, False, fault)

    def _jumps(self, time_s: float, value: float) -> bool:
        """Whether a value far from the last good one is a jump, until enough samples in a row agree that it is real."""
        if not math.isfinite(self._good):  # the first sample
            return False
        largest_rate = self.limits.max_rate
        elapsed_s = max(time_s - self._candidate_s, _LEAST_ELAPSED_S)
        agrees = self._agreeing and abs(value - self._candidate) <= largest_rate * elapsed_s
        self._agreeing = self._agreeing + 1 if agrees else 1
        self._candidate, self._candidate_s = value, time_s
        return self._agreeing < self.limits.confirm_samples


class SensorGuard:
    """Judges the three sensors of a tick together, by default with the limits of ``controller.yaml``."""

    def __init__(self, limits: dict[str, SensorLimits] | None = None) -> None:
        self.reasons = dict.fromkeys(SENSORS, "")  #: by sensor, why its last sample was not used; empty where it was
        self._limits = sensor_limits() if limits is None else limits
        self.reset()

    def reset(self) -> None:
        """Forget the past, as at a restart of time."""
        self._sensors = {name: SensorValidity(self._limits[name]) for name in SENSORS}

    def configure(self, limits: dict[str, SensorLimits]) -> None:
        """Use other limits from now on; the history stays."""
        self._limits = limits
        for name, sensor in self._sensors.items():
            sensor.limits = limits[name]

    def measure(self, time_s: float, values: dict[str, float], drives: Command | None = None) -> Measurement:
        """Return the measurement of the tick at ``time_s``.

        ``values`` has the samples by sensor (mm, N m, degC), ``drives`` the force and speed that the drives report.
        """
        readings = [one.update(time_s, values.get(name)) for name, one in self._sensors.items()]
        depth, torque, temperature = readings
        held: tuple[str, ...] = ()
        for name, reading in zip(SENSORS, readings, strict=True):
            self.reasons[name] = reading.reason
            if reading.held:
                held += (name,)
        return Measurement(
            time_s,
            depth.value,
            torque.value,
            temperature.value,
            depth.valid,
            torque.valid,
            temperature.valid,
            held=held,
            force_kn=math.nan if drives is None else drives.force_kn,
            speed_rpm=math.nan if drives is None else drives.speed_rpm,
        )
