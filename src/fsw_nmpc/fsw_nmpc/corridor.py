"""Set-point corridors with a dead-band: those of the paper, (32)-(33), and one that the handles can follow.

``recentred``, the paper's: first order, restarts at the output in every cycle. ``continuing``: first order, goes on by
itself, whatever the output does. ``shaped``: see :mod:`fsw_nmpc.shape`; it knows the disturbance of the output too.
"""

from __future__ import annotations

from math import exp

import numpy as np
from numpy.typing import NDArray

from fsw_nmpc.shape import Shape, ShapedPath

Vector = NDArray[np.float64]
KINDS = ("shaped", "continuing", "recentred")


class Corridor:
    """Corridor of one output.

    Parameters
    ----------
    time_s : (n,) array
        Output points of the horizon.
    time_constant_s : float
        Of the first-order corridors; 0 means a step.
    dead_band : float
        Half width.
    kind : str
        One of ``KINDS``.
    shape : Shape
        Of the shaped corridor.
    """

    def __init__(self, time_s: Vector, time_constant_s: float, dead_band: float, kind: str, shape: Shape) -> None:
        self._decay = np.exp(-time_s / time_constant_s) if time_constant_s > 0 else np.zeros(len(time_s))
        self._time_constant_s = time_constant_s
        self._dead_band = dead_band
        self._kind = kind
        self._path = ShapedPath(time_s, shape)
        self._centre: float | None = None

    @property
    def centre(self) -> float | None:
        """The filtered set-point now; None before the first band."""
        return self._centre

    def start_at(self, centre: float | None) -> None:
        """Continue from a given filtered set-point (None: from the next output)."""
        self._centre = centre
        self._path.forget(0.0)

    def follow(self, other: Corridor) -> None:
        """Go on where another corridor is now, without a jump."""
        self.start_at(other.centre)
        if self._kind == other._kind == "shaped" and other.centre is not None:
            self._path.follow(other._path)

    def bands(self, set_point: float, output: float, dt_s: float, disturbance: float = 0.0) -> tuple[Vector, Vector]:
        """Low and high edge over the horizon; advances the corridor by ``dt_s``.

        Parameters
        ----------
        set_point, output : float
            Where to go, and where the output is now.
        dt_s : float
            Time since the last call.
        disturbance : float
            Part of the output that is disturbance, as far as it is known.

        Returns
        -------
        low, high : (n,) arrays
        """
        width = self._dead_band
        if self._kind == "recentred":
            self._centre = output
            low, high = set_point - width, set_point + width
            return low + (output - low) * self._decay, high + (output - high) * self._decay
        if self._kind == "shaped":
            path = self._shaped(set_point, output, dt_s, disturbance)
            return path - width, path + width
        if self._centre is None:
            self._centre = output
        distance = (self._centre - set_point) * self._decay
        step = exp(-dt_s / self._time_constant_s) if self._time_constant_s > 0 else 0.0
        self._centre = set_point + (self._centre - set_point) * step
        return set_point - width + distance, set_point + width + distance

    def _shaped(self, set_point: float, output: float, dt_s: float, disturbance: float) -> Vector:
        path = self._path
        if not path.is_started:
            path.forget((output if self._centre is None else self._centre) - set_point)
        ahead = path.step(set_point, disturbance, dt_s)
        self._centre = set_point + path.distance
        return set_point + ahead
