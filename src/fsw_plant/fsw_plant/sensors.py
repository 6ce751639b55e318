"""Sensors: noise and quantisation, each sensor with a random stream of its own."""

from __future__ import annotations

import numpy as np

#: Random numbers drawn at once: numpy is too slow to be called for single ones.
BLOCK = 1024


class NoisySensor:
    """One sensor's noise (standard deviation) and resolution, in its unit; 0: none.

    Each reading takes one random number, whatever happens to it, so the stream depends on seed and tick alone.
    """

    def __init__(self, seed: int, index: int, noise: float, resolution: float) -> None:
        self.noise = noise
        self.resolution = resolution
        self._generator = np.random.Generator(np.random.PCG64([seed, index]))
        self._block: list[float] = []

    def read(self, value: float) -> float:
        """What the sensor shows of ``value``."""
        if not self._block:
            self._block = self._generator.standard_normal(BLOCK)[::-1].tolist()
        value += self.noise * self._block.pop()
        if self.resolution > 0.0:
            return round(value / self.resolution) * self.resolution
        return value
