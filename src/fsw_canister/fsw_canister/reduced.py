"""The canister's heat in some two thousand decoupled complex numbers, stepped exactly.

The projected matrices of each mode (``projection.py``) are diagonalised, so that a step with power, traverse speed and
axial position held is one multiplication per state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite, pi
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fsw_canister.cache import projection_of
from fsw_canister.copper import Kirchhoff
from fsw_canister.elements import elements_of
from fsw_canister.parameters import CanisterParameters
from fsw_canister.projection import Progress, Projection
from fsw_schema.models import InputError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def load_or_reduce(
    parameters: CanisterParameters, cache: Path | None = None, progress: Progress | None = None
) -> ReducedCanister:
    """The reduced model, from the cache or made now, which takes some ten seconds.

    Parameters
    ----------
    parameters : CanisterParameters
    cache : Path, optional
        Folder of the cache, or a file (``.npz``) that must be of this geometry; by default the user's cache.
    progress : callable, optional
        Called with the share that is done, and a text.

    Raises
    ------
    fsw_schema.models.InputError
        If a file is of another geometry, or scikit-fem is needed and not installed.
    """
    return ReducedCanister(parameters, projection_of(parameters, cache, progress))


@dataclass(frozen=True, slots=True)
class CanisterState:
    """Heat in the canister and where the tool is.

    Attributes
    ----------
    modes : (states,) complex array
        Amplitudes of theta (``copper.py``) in the eigenvectors.
    angle_rad, axial_mm : float
        Place of the tool: around the canister from its start, and above the joint line.
    power_kw : float
        Power of the last step.
    """

    modes: Complex
    angle_rad: float = 0.0
    axial_mm: float = 0.0
    power_kw: float = 0.0

    def copy(self) -> CanisterState:
        """Independent copy."""
        return replace(self, modes=self.modes.copy())


class ReducedCanister:
    """The canister's heat, stepped exactly for a power, a traverse speed and an axial position that are held.

    Parameters
    ----------
    parameters : CanisterParameters
    projection : Projection
        Of the same geometry.

    Attributes
    ----------
    parameters : CanisterParameters
    states : int
        Complex numbers in a state.
    decay_per_s : (states,) array
    """

    def __init__(self, parameters: CanisterParameters, projection: Projection) -> None:
        p, q = parameters, projection
        self.parameters = p
        self.copper = Kirchhoff(p)
        self.states = q.mode.size
        self._mode, self._modes = q.mode, np.arange(q.mode[-1] + 1)
        self._radius_mm = p.outer_radius_mm
        self._axial_mm = q.axial_mm
        decay, turn = [], []
        for mode in self._modes:
            rows = np.flatnonzero(q.mode == mode)
            conduction, surface, clamp = (block[rows, : rows.size] for block in (q.conduction, q.surface, q.clamp))
            matrix = p.conductivity_w_per_m_k * conduction
            matrix = matrix + p.surface_w_per_m2_k * surface + p.clamp_w_per_m2_k * clamp
            values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
            decay.append(np.maximum(values, 0.0) / p.heat_capacity_j_per_m3_k)
            turn.append(vectors)
        self.decay_per_s = np.concatenate(decay)
        self._ends = np.cumsum([0, *(one.size for one in decay)])

        def turned(rows: Array) -> Array:
            return np.concatenate([rows[..., a:b] @ t for a, b, t in self._blocks(turn)], axis=-1)

        source = (1.0 - p.shoulder_share) * turned(q.probe) + p.shoulder_share * turned(q.shoulder)
        self._source = source * (1e3 * (1.0 - p.tool_share) / (2.0 * pi * p.heat_capacity_j_per_m3_k))
        twice = np.where(q.mode == 0, 1.0, 2.0)
        self._rim = turned(q.rim) * twice
        rest = (1.0 - p.shoulder_share) * q.rest_k_per_w[0] + p.shoulder_share * q.rest_k_per_w[1]
        self._rest = rest * (1e3 * (1.0 - p.tool_share) * float(q.typical_k) / p.conductivity_w_per_m_k)
        self._vectors = turned(q.vectors)
        self._ones = turned(q.ones)
        self._loss = p.surface_w_per_m2_k * turned(q.surface_ones) + p.clamp_w_per_m2_k * turned(q.clamp_ones)
        self._table = (float("nan"), (np.zeros(0), np.zeros(0), 0.0))
        self._turned: tuple[float, Complex] = (float("nan"), np.zeros(0, complex))
        self._response: tuple[tuple[float, float], Array, Complex] = ((-1.0, 0.0), np.zeros(0), np.zeros(0, complex))

    def _blocks(self, turn: list[Array]) -> list[tuple[int, int, Array]]:
        return list(zip(self._ends[:-1].tolist(), self._ends[1:].tolist(), turn, strict=True))

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
        return CanisterState(modes, angle_rad, self._checked(axial_mm))

    def _checked(self, axial_mm: float) -> float:
        low, high = self.parameters.lowest_mm, self.parameters.highest_mm
        if not low - 1e-9 <= axial_mm <= high + 1e-9:
            raise InputError(
                f"canister: tool at {axial_mm:g} mm is off the copper; {low:g} to {high:g} mm above the joint"
            )
        return axial_mm

    def step(
        self, state: CanisterState, power_kw: float, traverse_mm_per_s: float, axial_mm: float, dt_s: float = 0.1
    ) -> CanisterState:
        """State after a step, with the inputs held.

        Parameters
        ----------
        state : CanisterState
        power_kw : float
            Power (24), tool's share included.
        traverse_mm_per_s : float
            At the outer surface; backwards if negative.
        axial_mm : float
            Tool's position above the joint line.
        dt_s : float

        Raises
        ------
        fsw_schema.models.InputError
            If an input is not finite, the tool is off the copper or the step is not positive.
        """
        if not isfinite(power_kw + traverse_mm_per_s + axial_mm):
            raise InputError(
                f"canister: power {power_kw} kW, traverse {traverse_mm_per_s} mm/s, position {axial_mm} mm: not finite"
            )
        if not 0.0 < dt_s < 1e6:
            raise InputError(f"canister: step of {dt_s} s; must be above 0")
        source, _, _ = self._at(axial_mm)
        decay, response = self._over(traverse_mm_per_s, dt_s)
        driven = np.conj(self._phase(state.angle_rad))
        driven *= response
        driven *= source
        driven *= power_kw
        driven += decay * state.modes
        turned = traverse_mm_per_s * dt_s / self._radius_mm
        return CanisterState(driven, state.angle_rad + turned, axial_mm, power_kw)

    def _phase(self, angle_rad: float) -> Complex:
        """Phase of the tool in each state's mode."""
        if angle_rad != self._turned[0]:
            self._turned = (angle_rad, np.exp((1j * angle_rad) * self._modes)[self._mode])
        return self._turned[1]

    def _at(self, axial_mm: float) -> tuple[Array, Array, float]:
        """Source, rim and what is left out there for a position, by cubics through the table."""
        if axial_mm != self._table[0]:
            self._checked(axial_mm)
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
            self._table = (axial_mm, (weights @ self._source[near], weights @ self._rim[near], rest))
        return self._table[1]

    def _over(self, traverse_mm_per_s: float, dt_s: float) -> tuple[Array, Complex]:
        """Decay over a step and response to a load that turns meanwhile."""
        if (traverse_mm_per_s, dt_s) != self._response[0]:
            turning = 1j * traverse_mm_per_s / self._radius_mm * self._mode
            rate = self.decay_per_s - turning
            decay = np.exp(-self.decay_per_s * dt_s)
            still = np.abs(rate) * dt_s < 1e-7
            response = np.where(still, dt_s, (np.exp(-turning * dt_s) - decay) / np.where(still, 1.0, rate))
            self._response = ((traverse_mm_per_s, dt_s), decay, response)
        return self._response[1], self._response[2]

    def stir_zone_temperature_c(self, state: CanisterState) -> float:
        """Mean temperature at the probe's rim; it takes the place of the copper's temperature of (16)."""
        _, rim, rest = self._at(state.axial_mm)
        theta = np.dot(rim * self._phase(state.angle_rad), state.modes).real + rest * state.power_kw
        return float(self.copper.temperature_c(theta))

    def temperature_c(
        self, state: CanisterState, radius_mm: ArrayLike, angle_rad: ArrayLike, axial_mm: ArrayLike
    ) -> Array:
        """Temperatures anywhere in the copper: virtual thermocouples; the shapes are broadcast.

        Raises
        ------
        fsw_schema.models.InputError
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
