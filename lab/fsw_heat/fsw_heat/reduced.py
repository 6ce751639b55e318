"""The canister's heat in some two thousand decoupled complex numbers, stepped exactly.

The projected matrices of each mode (``projection.py``) are diagonalised, so that a step with
power, traverse speed and axial position held is one multiplication per state.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite, pi
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from fsw_control.schema.models import InputError
from fsw_heat.cache import projection_of
from fsw_heat.elements import elements_of
from fsw_heat.heat_model import TYPICAL, Array, CanisterState, Complex, HeatModel
from fsw_heat.projection import Progress, Projection
from fsw_plant.canister import CanisterParameters
from fsw_plant.library import KERNEL


def load_or_reduce(
    parameters: CanisterParameters, cache: Path | None = None, progress: Progress | None = None
) -> ReducedCanister:
    """The reduced model, from the cache or made now, which takes some ten seconds.

    ``cache`` is a folder, by default the user's cache, or a file (``.npz``) that must be of this
    geometry. ``progress`` gets the share that is done and a text.

    Raises
    ------
    fsw_control.schema.models.InputError
        If a file is of another geometry, or scikit-fem is needed and not installed.
    """
    return ReducedCanister(parameters, projection_of(parameters, cache, progress))


class ReducedCanister(HeatModel):
    """The canister's heat, stepped exactly for a held power, traverse speed and axial position.

    Parameters and projection are of the same geometry.
    """

    def __init__(self, parameters: CanisterParameters, projection: Projection) -> None:
        p, q = parameters, projection
        self.states = q.mode.size  #: complex numbers in a state
        self._mode, self._modes = q.mode, np.arange(q.mode[-1] + 1)
        self._radius_mm = p.outer_radius_mm
        decay, turn = q.diagonal(
            p.conductivity_w_per_m_k, p.surface_w_per_m2_k, p.clamp_w_per_m2_k
        )
        self.decay_per_s = np.maximum(decay, 0.0) / p.heat_capacity_j_per_m3_k
        self._ends = q.ends
        source = p.into_copper(q.turned(q.probe, turn), q.turned(q.shoulder, turn))
        rest = p.into_copper(*q.rest_k_per_w) * (TYPICAL["k"] / p.conductivity_w_per_m_k)
        source = source / (2.0 * pi * p.heat_capacity_j_per_m3_k)
        super().__init__(p)
        self._axial_mm, self._source, self._rest = q.axial_mm, source, rest
        self._rim = q.turned(q.rim, turn) * np.where(q.mode == 0, 1.0, 2.0)
        self._table = (float("nan"), (np.zeros(0), np.zeros(0), 0.0))
        self._vectors, self._ones = q.turned(q.vectors, turn), q.turned(q.ones, turn)
        self._loss = p.surface_w_per_m2_k * q.turned(q.surface_ones, turn)
        self._loss = self._loss + p.clamp_w_per_m2_k * q.turned(q.clamp_ones, turn)
        self._turned: tuple[float, Complex] = (float("nan"), np.zeros(0, complex))
        self._response: tuple[tuple[float, float], Array, Complex] = (
            (-1.0, 0.0),
            np.zeros(0),
            np.zeros(0, complex),
        )

    def initial(
        self, temperature_c: float | None = None, angle_rad: float = 0.0, axial_mm: float = 0.0
    ) -> CanisterState:
        """A canister of one temperature everywhere, the ambient one by default."""
        modes = np.zeros(self.states, complex)
        if temperature_c is not None:
            if not isfinite(temperature_c):
                raise InputError(f"canister: temperature {temperature_c} degC is no number")
            theta = float(self.copper.theta(temperature_c))
            volume = self._ones[: self._ends[1]]
            modes[: self._ends[1]] = theta * volume / (2.0 * pi)
        return CanisterState(modes, angle_rad, self.parameters.checked(axial_mm))

    def _driven(
        self,
        state: CanisterState,
        power_kw: float,
        traverse_mm_per_s: float,
        axial_mm: float,
        dt_s: float,
    ) -> Complex:
        source, _, _ = self._at(axial_mm)
        decay, response = self._over(traverse_mm_per_s, dt_s)
        driven = np.conj(self._phase(state.angle_rad))
        driven *= response
        driven *= source
        driven *= power_kw
        driven += decay * state.modes
        return driven

    def _phase(self, angle_rad: float) -> Complex:
        """Phase of the tool in each state's mode."""
        if angle_rad != self._turned[0]:
            self._turned = (angle_rad, np.exp((1j * angle_rad) * self._modes)[self._mode])
        return self._turned[1]

    def _at(self, axial_mm: float) -> tuple[Array, Array, float]:
        """Source, rim and feedthrough at a position, by cubic interpolation of the tables."""
        if axial_mm != self._table[0]:
            grid = self._axial_mm
            at = (axial_mm - grid[0]) / (grid[1] - grid[0])
            first = min(max(int(at) - 1, 0), len(grid) - 4)
            x = at - first
            weights = np.array(
                [
                    (1 - x) * (x - 2) * (x - 3) / 6,
                    x * (x - 2) * (x - 3) / 2,
                    -x * (x - 1) * (x - 3) / 2,
                    x * (x - 1) * (x - 2) / 6,
                ]
            )
            near = slice(first, first + 4)
            rest = float(weights @ self._rest[near])
            self._table = (
                axial_mm,
                (weights @ self._source[near], weights @ self._rim[near], rest),
            )
        return self._table[1]

    def _over(self, traverse_mm_per_s: float, dt_s: float) -> tuple[Array, Complex]:
        """Decay over a step and response to a load that turns meanwhile."""
        if (traverse_mm_per_s, dt_s) != self._response[0]:
            turning = 1j * traverse_mm_per_s / self._radius_mm * self._mode
            rate = self.decay_per_s - turning
            decay = np.exp(-self.decay_per_s * dt_s)
            still = np.abs(rate) * dt_s < 1e-7
            response = np.where(
                still, dt_s, (np.exp(-turning * dt_s) - decay) / np.where(still, 1.0, rate)
            )
            self._response = ((traverse_mm_per_s, dt_s), decay, response)
        return self._response[1], self._response[2]

    def stir_zone_temperature_c(self, state: CanisterState) -> float:
        """See :meth:`HeatModel.stir_zone_temperature_c`."""
        _, rim, rest = self._at(state.axial_mm)
        theta = (
            np.dot(rim * self._phase(state.angle_rad), state.modes).real + rest * state.power_kw
        )
        return float(self.copper.temperature_c(theta))

    def temperature_c(
        self, state: CanisterState, radius_mm: ArrayLike, angle_rad: ArrayLike, axial_mm: ArrayLike
    ) -> Array:
        """Temperatures anywhere in the copper: virtual thermocouples; the shapes are broadcast.

        Raises
        ------
        fsw_control.schema.models.InputError
            If a point is not in the copper, or scikit-fem is not installed.
        """
        r, angle, z = np.broadcast_arrays(radius_mm, angle_rad, axial_mm)
        if not r.size:
            return np.zeros(r.shape)
        if not np.isfinite(angle).all():
            raise InputError("canister: the angle of a thermocouple is not finite")
        places, place = np.unique(np.stack([r.ravel(), z.ravel()]), axis=1, return_inverse=True)
        angles, which = np.unique(angle.ravel(), return_inverse=True)
        at = elements_of(self.parameters).at(1e-3 * places[0], 1e-3 * places[1])
        weighted = np.where(self._mode == 0, 1.0, 2.0) * (at @ self._vectors) * state.modes
        by_mode = np.add.reduceat(weighted, self._ends[:-1], axis=1)
        phases = np.exp(1j * np.outer(self._modes, angles))
        theta = (by_mode @ phases).real[place.ravel(), which.ravel()]
        return np.asarray(self.copper.temperature_c(theta)).reshape(r.shape)

    def stored_j(self, state: CanisterState) -> float:
        """Heat in the copper since ambient, as conduction with a constant k/c counts it."""
        return float(self.parameters.heat_capacity_j_per_m3_k * (self._ones @ state.modes.real))

    def loss_w(self, state: CanisterState) -> float:
        """Heat that leaves at present to air and clamp."""
        return float(self._loss @ state.modes.real)


def heated(
    canister: HeatModel,
    power_kw: float,
    motion: tuple[float, float],
    dt_s: float,
    missing_c: Callable[[CanisterState], float],
) -> CanisterState:
    """Heat a canister from ambient by a constant power, in steps of ``dt_s``.

    ``motion`` of the tool is traverse [mm/s] and position above the joint line [mm]. ``missing_c``
    is called with each state, including the first: the remaining temperature rise; heating ends
    at 0.

    Raises
    ------
    fsw_control.schema.models.InputError
        If that takes too long, or the tool is off the copper.
    """
    traverse, axial_mm = motion
    state = canister.initial(axial_mm=axial_mm)
    for _ in range(round(KERNEL.lib.FSW_PLANT_LONGEST_S / dt_s)):
        if (rest_c := missing_c(state)) <= 0.0:
            return state
        state = canister.step(state, power_kw, traverse, axial_mm, dt_s)
    raise InputError(f"{power_kw:g} kW leave {rest_c:.1f} degC missing of heating for too long")
