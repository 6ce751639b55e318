"""Sensors: which there are, noise settings, and the random numbers of their noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fsw_control.sensors import DEPTH_CHANNELS, REQUIRED, SENSORS
from fsw_plant.config import PlantConfig

#: number of random values drawn at once: numpy is too slow for single ones
BLOCK = 1024


class Noise(NamedTuple):
    """Noise and quantisation of a sensor."""

    deviation: float = 0.0  #: standard deviation of the noise, in the sensor's unit; 0: none
    resolution: float = 0.0  #: quantisation, in the sensor's unit; 0: none
    correlation_s: float = (
        0.0  #: time after which the noise's autocorrelation is down to 1/e; 0: white
    )


class Draws:
    """Standard normal numbers for a plant's sensors, from a random stream for each sensor.

    Each reading takes one number, whatever happens to it, so the stream depends on seed and tick
    alone.
    """

    def __init__(self, seed: int, sensors: int = len(REQUIRED)) -> None:
        self._generators = [
            np.random.Generator(np.random.PCG64([seed, i])) for i in range(sensors)
        ]

    def block(self) -> NDArray[np.float64]:
        """The next ``BLOCK`` numbers of each sensor, (BLOCK, sensors)."""
        drawn = [generator.standard_normal(BLOCK) for generator in self._generators]
        return np.ascontiguousarray(np.transpose(drawn))


def sensors_of(config: PlantConfig) -> tuple[str, ...]:
    """Names of the plant's sensors, in the order of the table."""
    channels = config.machine.depth_channels
    return tuple(name for name in SENSORS if channels or name not in DEPTH_CHANNELS)


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
