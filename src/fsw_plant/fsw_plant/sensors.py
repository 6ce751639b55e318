"""Sensors: noise, quantisation and faults, each sensor with its own random stream."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fsw_control import SENSORS
from fsw_plant.config import PlantConfig
from fsw_plant.events import Fault, Sample

#: Random numbers drawn at once: numpy is too slow to be called for single ones.
BLOCK = 1024


class Sensor:
    """One sensor with its noise (standard deviation) and resolution, in its unit; 0: without.

    Each reading takes one random number, whatever happens to it, so the stream depends on seed and tick alone.
    """

    def __init__(self, seed: int, index: int, noise: float, resolution: float) -> None:
        self.noise = noise
        self.resolution = resolution
        self._generator = np.random.Generator(np.random.PCG64([seed, index]))
        self._block: list[float] = []
        self._last: float | None = None

    def read(self, value: float) -> float:
        """The reading of ``value``."""
        if not self._block:
            self._block = self._generator.standard_normal(BLOCK)[::-1].tolist()
        value += self.noise * self._block.pop()
        if self.resolution > 0.0:
            return round(value / self.resolution) * self.resolution
        return value

    def send(self, value: float, stamp_ns: int, fault: Fault | None, time_s: float) -> tuple[Sample, ...]:
        """The samples of ``value`` that leave the sensor at a tick, with its fault at that time."""
        last, self._last = self._last, self.read(value)
        sample = Sample(stamp_ns, self._last)
        return (sample,) if fault is None else fault.pass_on(sample, time_s, last)


class Sensors:
    """The sensors of a plant, in the order of ``SENSORS``."""

    def __init__(self, config: PlantConfig) -> None:
        self._all = [Sensor(config["seed"], i, *noise) for i, noise in enumerate(noise_of(config))]

    def configure(self, config: PlantConfig) -> None:
        """Change noise and resolution."""
        for sensor, (noise, resolution) in zip(self._all, noise_of(config), strict=True):
            sensor.noise, sensor.resolution = noise, resolution

    def send(
        self, values: tuple[float, ...], stamp_ns: int, faults: Mapping[str, Fault], time_s: float
    ) -> list[tuple[Sample, ...]]:
        """The samples of the values that leave the sensors at a tick."""
        return [
            sensor.send(value, stamp_ns, faults.get(name), time_s)
            for name, sensor, value in zip(SENSORS, self._all, values, strict=True)
        ]


def noise_of(config: PlantConfig) -> tuple[tuple[float, float], ...]:
    """Noise and resolution of each sensor."""
    if not config["noise"]:
        return ((0.0, 0.0),) * len(SENSORS)
    return (
        (config["sensors.depth_noise_mm"], config["sensors.depth_resolution_mm"]),
        (config["sensors.torque_noise_nm"], config["sensors.torque_resolution_nm"]),
        (config["sensors.temperature_noise_c"], config["sensors.temperature_resolution_c"]),
    )
