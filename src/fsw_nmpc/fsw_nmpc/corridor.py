"""First-order set-point corridors with a dead-band, (32)-(33) of the paper."""

from __future__ import annotations

from math import exp

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class Corridor:
    """Corridor of one output.

    Parameters
    ----------
    time_s : (n,) array
        Output points of the horizon.
    time_constant_s : float
        0 means a step.
    dead_band : float
        Half width.
    continuing : bool
        Whether the filtered set-point goes on by itself, or restarts at the output in every cycle.
    """

    def __init__(self, time_s: Vector, time_constant_s: float, dead_band: float, continuing: bool) -> None:
        self._decay = np.exp(-time_s / time_constant_s) if time_constant_s > 0 else np.zeros(len(time_s))
        self._time_constant_s = time_constant_s
        self._dead_band = dead_band
        self._continuing = continuing
        self._centre: float | None = None

    @property
    def centre(self) -> float | None:
        """The filtered set-point now; None before the first band."""
        return self._centre

    def start_at(self, centre: float | None) -> None:
        """Continue from a given filtered set-point (None: from the next output)."""
        self._centre = centre

    def bands(self, set_point: float, output: float, dt_s: float) -> tuple[Vector, Vector]:
        """Low and high edge over the horizon; advances the filtered set-point by ``dt_s``.

        Parameters
        ----------
        set_point, output : float
            Where to go, and where the output is now.
        dt_s : float
            Time since the last call.

        Returns
        -------
        low, high : (n,) arrays
        """
        width = self._dead_band
        if not self._continuing:
            low, high = set_point - width, set_point + width
            return low + (output - low) * self._decay, high + (output - high) * self._decay
        if self._centre is None:
            self._centre = output
        distance = (self._centre - set_point) * self._decay
        step = exp(-dt_s / self._time_constant_s) if self._time_constant_s > 0 else 0.0
        self._centre = set_point + (self._centre - set_point) * step
        return set_point - width + distance, set_point + width + distance
