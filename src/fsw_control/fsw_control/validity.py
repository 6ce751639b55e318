"""Whether sensor samples are usable: finite, in range, no spike or jump, not frozen or missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from fsw_control.common_parameters import ControllerParameters
from fsw_control.contract import Command, Measurement
from fsw_control.parameters import defaults
from fsw_control.sensors import OPTIONAL, REQUIRED, SENSORS

#: probability at which a run of equal samples is no longer attributed to chance
_CHANCE = 1e-9
#: relative difference below which samples count as equal, as in a simulation without noise
_ROUNDING = 1e-9
#: share of reversals of direction above which a signal counts as noisy (white noise: 2/3, a smooth
#: signal: ~0)
_NOISY = 0.25
#: number of samples before a sensor is judged to be frozen
_LEARNT = 20
#: upper bound of the share of equal neighbours
_LARGEST_SHARE = 0.95
#: standard deviations added to that share, because it was estimated from few samples
_DEVIATIONS = 3.0
#: changes are judged over at least this time, because stamps jitter [s]
_LEAST_ELAPSED_S = 0.05
#: samples over which the noise and the share of equal neighbours are averaged
_MEMORY = 150
#: share of changes larger than a step from which on the noise is large beside it (chosen: one
#: spike, of two changes, is fewer)
_SKIPPING = 0.015
#: share of the expected noise below which changes are rounding or quantisation, not noise (chosen)
_QUIET_SHARE = 0.2


class Flaw(StrEnum):
    """Why a sample is rejected; false if it is good."""

    NONE = ""
    MISSING = "missing"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    FROZEN = "frozen"
    TOO_FAST = "too fast"
    RECOVERING = "recovering"
    JUMPED = "jumped"


@dataclass(frozen=True, slots=True)
class SensorLimits:
    """Limits of a sensor in its unit (mm, N m, degC): the parameters ``validity.*``.

    A change faster than ``max_rate`` against the last good sample is a spike, unless
    ``confirm_samples`` samples in a row agree with each other. As many are needed to become valid
    again. If they agree on a value further than ``max_jump`` (per second; in the first second as
    a whole) from the last good one, the sensor has jumped: it stays invalid until it returns or is
    readmitted. A sensor that changes far less than its ``noise`` (standard deviation) is never
    judged to be frozen.
    """

    minimum: float
    maximum: float
    max_rate: float
    hold_s: float
    frozen_samples: int
    confirm_samples: int
    max_jump: float = math.inf
    noise: float = 0.0


def sensor_limits(values: Mapping[str, Any] | None = None) -> dict[str, SensorLimits]:
    """Limits of all sensors from parameters ``validity.*``, by default of every controller."""
    if values is None:
        values = defaults(ControllerParameters)
    shared = {name: values[f"validity.{name}"] for name in ("frozen_samples", "confirm_samples")}
    # only the supervisor has max_jump: other nodes believe a jump, because an operator cannot
    # acknowledge there; bags of earlier versions lack noise
    names = ("minimum", "maximum", "max_rate", "max_jump", "noise")
    limits = {}
    for sensor in SENSORS:
        keys = {name: f"validity.{sensor}.{name}" for name in names}
        own = {name: values[key] for name, key in keys.items() if key in values}
        limits[sensor] = SensorLimits(hold_s=values["validity.hold"], **shared, **own)
    return limits


class Reading(NamedTuple):
    """A sensor at one tick: the value to use (NaN if invalid) and the flaw of its sample, if any.

    ``held``: the value is the last good one, not a measurement of this tick.
    """

    value: float
    valid: bool
    reason: Flaw = Flaw.NONE
    held: bool = False


class Frozen:
    """Distinguishes a frozen sensor from a quantised or noise-free signal that stands still.

    A run of equal samples is suspicious only if the signal was noisy before, with changes of the
    size of the sensor's expected noise, and only if the run is longer than the share of equal
    neighbours makes likely: the observed one, or that in the middle of a step of the resolution.
    """

    def __init__(self) -> None:
        self._run = 0
        self._last = math.nan
        self._rising = False
        self._count = 0
        self._equal = 0.0
        self._reversed = 0.0
        self._change = 0.0  # mean, of neighbours that differ
        self._step = math.inf  # smallest change: the resolution, if the sensor is quantised
        self._far = 0.0  # share of the changes that are larger than a step

    def update(self, value: float, samples: int, noise: float = 0.0) -> bool:
        """Take the next sample; return whether the sensor is frozen.

        ``samples`` is the shortest run of equal samples that counts (0: never frozen), ``noise``
        the expected standard deviation: a much quieter signal is not judged.
        """
        last = self._last
        if abs(value - last) <= _ROUNDING * abs(value):
            self._run += 1
            return self._change >= _QUIET_SHARE * noise and self._is_frozen(samples, noise)
        # A run of equal samples is learnt only after its end, and not if it was a freeze, which
        # must not pass for a normal standstill later.
        if self._run:
            if not self._is_frozen(samples, noise):
                for _ in range(min(self._run, _MEMORY)):
                    self._equal += (1.0 - self._equal) * self._weight()
            self._run = 0
        rising = value > last
        if last == last:  # not the first sample
            weight = self._weight()
            self._equal -= self._equal * weight
            self._reversed += ((rising != self._rising) - self._reversed) * weight
            self._change += (abs(value - last) - self._change) * weight
            self._step = min(self._step, abs(value - last))
            self._far += ((abs(value - last) > 1.5 * self._step) - self._far) * weight
        self._rising, self._last = rising, value
        return False

    def is_noisy(self, noise: float) -> bool:
        """Whether the signal has shown noise of the expected size."""
        learnt = self._count >= _LEARNT and self._reversed >= _NOISY
        return learnt and self._change >= _QUIET_SHARE * noise

    def has_never_moved(self, samples: int) -> bool:
        """Whether all samples, this many or more, were equal."""
        return self._count == 0 and 0 < samples <= self._run + 1

    def _weight(self) -> float:
        if self._count < _MEMORY:
            self._count += 1
        return 1.0 / self._count

    def _is_frozen(self, samples: int, noise: float) -> bool:
        is_short = not samples or self._run < samples - 1
        if is_short or self._count < _LEARNT or self._reversed < _NOISY:
            return False
        # Neighbours of a live signal are equal with probability p, so a run of n has p**n. A run
        # is a freeze once this falls below _CHANCE. p is the learnt share plus three standard
        # errors of a proportion (the 2 because neighbouring pairs share a sample).
        likely = max(self._equal, 1.0 / self._count)
        deviation = math.sqrt(likely * (1.0 - likely) / (2.0 * self._count))
        share = min(likely + _DEVIATIONS * deviation, _LARGEST_SHARE)
        # What was learnt at the edge between two steps does not hold in the middle of one: there a
        # sample changes only if the noise exceeds half a step. Not so where samples skip a step,
        # which noise of that size hardly does: then the noise is larger than expected.
        if noise > 0.0 and self._far <= _SKIPPING:
            share = max(share, math.erf(self._step / (math.sqrt(8.0) * noise)) ** 2)
        return share < 1.0 and self._run >= math.log(_CHANCE) / math.log(share)


class SensorValidity:
    """Judges one sensor, sample by sample; ``limits`` may be replaced at any time."""

    def __init__(self, limits: SensorLimits) -> None:
        self.limits = limits
        self.jumped = False  #: further from its last good value than anything explains
        self.last_good = math.nan  #: the last sample that was used
        self._frozen = Frozen()
        self._good_s = -math.inf
        self._reach = math.inf
        self._candidate = math.nan
        self._candidate_s = -math.inf
        self._agreeing = 0
        self._valid = False

    def update(self, time_s: float, value: float | None) -> Reading:
        """Judge the sample of the tick at ``time_s``; None if it is missing."""
        flaw = self._flaw(time_s, value)
        if flaw is None:
            assert value is not None
            self._accept(time_s, value)
            return Reading(value, True)
        if flaw not in (Flaw.TOO_FAST, Flaw.RECOVERING, Flaw.JUMPED):
            self._agreeing = 0
        bridged = self._valid and flaw not in (Flaw.FROZEN, Flaw.JUMPED)
        if bridged and time_s - self._good_s <= self.limits.hold_s + 1e-9:
            return Reading(self.last_good, True, flaw, held=True)
        self._valid = False
        return Reading(math.nan, False, flaw)

    @property
    def steady(self) -> bool:
        """Whether it is steady since its jump, so that it may be readmitted."""
        return self.jumped and self._agreeing >= self.limits.confirm_samples

    def readmit(self) -> bool:
        """Accept a jumped sensor after an acknowledgement; return whether it was steady enough."""
        if not self.steady:
            return False
        self._accept(self._candidate_s, self._candidate)
        return True

    def begun_again(self) -> SensorValidity:
        """Return a fresh judge of the sensor, for a clock that went back; only a jump is kept."""
        fresh = SensorValidity(self.limits)
        if self.jumped:
            fresh.jumped, fresh.last_good, fresh._reach = True, self.last_good, self._reach
        return fresh

    def _accept(self, time_s: float, value: float) -> None:
        self.last_good, self._good_s, self._valid = value, time_s, True
        self._agreeing, self.jumped = 0, False

    def _flaw(self, time_s: float, value: float | None) -> Flaw | None:
        """Return why a sample is rejected; None if it is good."""
        limits = self.limits
        if value is None:
            return Flaw.MISSING
        if not math.isfinite(value):
            return Flaw.NOT_FINITE
        frozen = self._frozen.update(value, limits.frozen_samples, limits.noise)
        if not limits.minimum <= value <= limits.maximum:
            return Flaw.OUT_OF_RANGE
        if frozen:
            return Flaw.FROZEN
        if not math.isfinite(self.last_good):  # the first sample
            return None
        change, elapsed_s = abs(value - self.last_good), time_s - self._good_s
        reach = self._reach if self.jumped else limits.max_jump * max(elapsed_s, 1.0)
        fastest = limits.max_rate * max(elapsed_s, _LEAST_ELAPSED_S)
        if self._valid and change <= min(fastest, reach):
            return None
        if not self._agrees(time_s, value):
            if self.jumped:
                return Flaw.JUMPED
            return Flaw.TOO_FAST if self._valid else Flaw.RECOVERING
        if change <= reach:
            return None
        self.jumped, self._reach = True, reach
        return Flaw.JUMPED

    def _agrees(self, time_s: float, value: float) -> bool:
        """Whether enough samples in a row agree with each other, this one included."""
        elapsed_s = max(time_s - self._candidate_s, _LEAST_ELAPSED_S)
        reach = self.limits.max_rate * elapsed_s
        agrees = self._agreeing and abs(value - self._candidate) <= reach
        self._agreeing = self._agreeing + 1 if agrees else 1
        self._candidate, self._candidate_s = value, time_s
        return self._agreeing >= self.limits.confirm_samples


class SensorGuard:
    """Judges the sensors of a tick, by default with the limits of every controller."""

    def __init__(self, limits: dict[str, SensorLimits] | None = None) -> None:
        #: by sensor, why its last sample was rejected; empty if it was used
        self.reasons = dict.fromkeys(SENSORS, Flaw.NONE)
        self.held: tuple[str, ...] = ()  #: sensors whose last good value stands in for the sample
        self._limits = sensor_limits() if limits is None else limits
        self.reset()

    def reset(self) -> None:
        """Forget the past, as at a start."""
        self._sensors = {name: SensorValidity(self._limits[name]) for name in SENSORS}
        self._present = set(REQUIRED)  # and any other from its first sample on

    def forget_time(self) -> None:
        """Forget the past, as at a restart of time, but keep jumps."""
        self._sensors = {name: sensor.begun_again() for name, sensor in self._sensors.items()}

    @property
    def jumped(self) -> dict[str, float]:
        """Last good value of each jumped sensor, which is invalid until it is readmitted."""
        return {name: sensor.last_good for name, sensor in self._sensors.items() if sensor.jumped}

    @property
    def steady(self) -> tuple[str, ...]:
        """Sensors that have jumped and may be readmitted."""
        return tuple(name for name, sensor in self._sensors.items() if sensor.steady)

    def readmit(self) -> dict[str, float]:
        """Accept the jumped sensors that are steady, on acknowledgement; return their values."""
        return {
            name: sensor.last_good for name, sensor in self._sensors.items() if sensor.readmit()
        }

    def configure(self, limits: dict[str, SensorLimits]) -> None:
        """Use other limits from now on; the history stays."""
        self._limits = limits
        for name, sensor in self._sensors.items():
            sensor.limits = limits[name]

    def measure(
        self, time_s: float, values: Mapping[str, float], drives: Command | None = None
    ) -> Measurement:
        """Return the measurement of the tick at ``time_s``.

        ``values`` has the samples by sensor (mm, N m, degC), ``drives`` the force and speed that
        the drives report.
        """
        self._present.update(values)
        readings = {
            name: sensor.update(time_s, values.get(name))
            for name, sensor in self._sensors.items()
            if name in self._present
        }
        for name, reading in readings.items():
            self.reasons[name] = reading.reason
        self.held = tuple([name for name, reading in readings.items() if reading.held])
        depth, torque, temperature = (readings[name] for name in REQUIRED)
        missing = Reading(math.nan, False)
        return Measurement(
            *(time_s, depth.value, torque.value, temperature.value),
            *(depth.valid, torque.valid, temperature.valid),
            self.held,
            *(drives or Command(math.nan, math.nan)),
            {name: readings.get(name, missing).value for name in OPTIONAL},
        )
