"""Sensors: noise, quantisation and faults, each sensor with its own random stream."""

from __future__ import annotations

import numpy as np

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
