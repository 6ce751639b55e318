"""Sensors: noise, quantisation, faults and the thermocouple's lag, each with a random stream."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import NamedTuple

import numpy as np

from fsw_control.sensors import SENSORS
from fsw_plant.config import PlantConfig
from fsw_plant.events import Fault, Sample
from fsw_plant.lag import lag_left, lag_mean

#: number of random values drawn at once: numpy is too slow for single ones
BLOCK = 1024


class Noise(NamedTuple):
    """Noise and quantisation of a sensor."""

    deviation: float = 0.0  #: standard deviation of the noise, in the sensor's unit; 0: none
    resolution: float = 0.0  #: quantisation, in the sensor's unit; 0: none
    correlation_s: float = (
        0.0  #: time after which the noise's autocorrelation is down to 1/e; 0: white
    )

    @property
    def autocorrelation(self) -> float:
        """Share of the noise that remains after a tick."""
        return lag_left(self.correlation_s)


class Sensor:
    """A sensor whose noise is a first-order Gauss-Markov process: n' = a n + sqrt(1 - a²) e.

    Here a = exp(-tick / correlation time), so the samples are exact, and e is standard normal. The
    first sample is stationary. Each reading takes one random number, whatever happens to it, so
    the stream depends on seed and tick alone.
    """

    def __init__(self, seed: int, index: int, noise: Noise) -> None:
        self.configure(noise)
        self._generator = np.random.Generator(np.random.PCG64([seed, index]))
        self._block: list[float] = []
        self._last: float | None = None
        self._noise: float | None = None  # in standard deviations

    def configure(self, noise: Noise) -> None:
        """Change the noise; a correlated noise keeps its present value."""
        self._deviation, self._resolution = noise.deviation, noise.resolution
        self._kept = noise.autocorrelation
        self._fresh = sqrt(1.0 - self._kept**2)

    def read(self, value: float) -> float:
        """Return the reading of ``value``."""
        if not self._block:
            self._block = self._generator.standard_normal(BLOCK)[::-1].tolist()
        noise = self._block.pop()
        if self._kept and self._noise is not None:
            noise = self._kept * self._noise + self._fresh * noise
        self._noise = noise
        value += self._deviation * noise
        if self._resolution > 0.0:
            return round(value / self._resolution) * self._resolution
        return value

    def send(
        self, value: float, stamp_ns: int, fault: Fault | None, time_s: float
    ) -> tuple[Sample, ...]:
        """Samples of ``value`` that leave the sensor at a tick, with the fault at that time."""
        last, self._last = self._last, self.read(value)
        sample = Sample(stamp_ns, self._last)
        return (sample,) if fault is None else fault.pass_on(sample, time_s, last)


class Probe:
    """The thermocouple's probe, which follows the surrounding temperature with a lag (0: none).

    Between ticks the process temperature is linear and a disturbance of it constant; the
    first-order lag is solved exactly for both. At the start, when the process has the temperature
    ``start_c``, the probe is in equilibrium.
    """

    def __init__(self, lag_s: float, start_c: float) -> None:
        self._value_c = self._process_c = self._around_c = start_c
        self.lag_s = lag_s

    def read(self, around_c: float) -> float:
        """The probe's temperature at a tick; ``around_c`` includes the disturbance."""
        self._around_c = around_c
        return self._value_c if self.lag_s else around_c

    def advance(self, process_c: float) -> None:
        """Follow the process for a tick up to this temperature; the disturbance is held."""
        left, mean = lag_left(self.lag_s), lag_mean(self.lag_s)
        held_c, change_c = self._around_c, process_c - self._process_c
        self._value_c = held_c + left * (self._value_c - held_c) + (1.0 - mean) * change_c
        self._process_c, self._around_c = process_c, held_c + change_c


class Sensors:
    """The sensors of a plant; the thermocouple starts in equilibrium at ``start_c``."""

    def __init__(self, config: PlantConfig, start_c: float) -> None:
        noises = enumerate(noise_of(config).items())
        self._all = {name: Sensor(config["seed"], i, noise) for i, (name, noise) in noises}
        self._probe = Probe(config["sensors.temperature_lag_s"], start_c)

    def configure(self, config: PlantConfig) -> None:
        """Change noise and lag."""
        for name, noise in noise_of(config).items():
            self._all[name].configure(noise)
        self._probe.lag_s = config["sensors.temperature_lag_s"]

    def heat(self, process_c: float) -> None:
        """End a tick, see :meth:`Probe.advance`."""
        self._probe.advance(process_c)

    def send(
        self,
        values: Mapping[str, float],
        stamp_ns: int,
        faults: Mapping[str, Fault],
        time_s: float,
    ) -> dict[str, tuple[Sample, ...]]:
        """Samples that leave the sensors at a tick, by sensor."""
        shown = {**values, "thermocouple": self._probe.read(values["thermocouple"])}
        return {
            name: sensor.send(shown[name], stamp_ns, faults.get(name), time_s)
            for name, sensor in self._all.items()
        }


def noise_of(config: PlantConfig) -> dict[str, Noise]:
    """Noise of each sensor."""
    if not config["noise"]:
        return dict.fromkeys(SENSORS, Noise())
    return {
        name: Noise(
            config[f"sensors.{row.stem}_noise_{row.quantity.suffix}"],
            config[f"sensors.{row.stem}_resolution_{row.quantity.suffix}"],
            config[f"sensors.{row.stem}_noise_correlation_s"],
        )
        for name, row in SENSORS.items()
    }
