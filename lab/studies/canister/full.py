"""The canister's heat without reduction, the reference for the reduced model: all finite elements.

:class:`FullCanister` takes implicit steps, also with k(T), c(T) and radiation; nonlinear terms are
evaluated at the nodes around the circumference, by FFT. :func:`exact_stir_zone_c` has no error of
time: each mode is diagonalised.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fsw_heat.elements import Elements, one_thread
from fsw_heat.heat_model import Kirchhoff
from fsw_heat.history import ToolCourse
from fsw_plant.canister import STEFAN_BOLTZMANN, ZERO_C, CanisterParameters

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: diagonally implicit Runge-Kutta method of two stages and second order, L-stable (Alexander 1977)
_GAMMA = 1.0 - np.sqrt(0.5)
_CLOSE_K = 1e-4
_MOST_ITERATIONS = 60


@dataclass(frozen=True)
class FullState:
    """Heat in every node."""

    theta: Complex  #: (modes, size) theta (``heat_model.py``) of the Fourier modes
    heat: Complex  #: (modes, size) mass matrix times the heat stored in a volume since ambient
    #: place of the tool
    angle_rad: float = 0.0
    axial_mm: float = 0.0


class FullCanister:
    """All finite elements of the canister's end, with a fixed step.

    ``nonlinear``: take c(T) and radiation as they are, and k(T) unless the properties are
    constant: what the reduced model makes linear.
    """

    def __init__(
        self, parameters: CanisterParameters, step_s: float, nonlinear: bool = False
    ) -> None:
        from scipy.sparse.linalg import splu

        p = self.parameters = parameters
        self.step_s, self.nonlinear = step_s, nonlinear
        self.copper = Kirchhoff(p)
        self.elements = Elements(p)
        e, self._modes = self.elements, np.arange(p.modes + 1)
        self._capacity = p.heat_capacity_j_per_m3_k
        self._factors: list[Any] = []
        for mode in self._modes:
            implicit = (self._capacity * e.mass + _GAMMA * step_s * _matrix(e, int(mode))).tocsc()
            self._factors.append(
                splu(implicit, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            )
        self._loads: dict[float, tuple[Array, Array]] = {}

    def initial(
        self, temperature_c: float | None = None, angle_rad: float = 0.0, axial_mm: float = 0.0
    ) -> FullState:
        """A canister of one temperature everywhere, the ambient one by default."""
        theta = np.zeros((self._modes.size, self.elements.size), complex)
        if temperature_c is not None:
            theta[0] = self.copper.theta(temperature_c)
        return FullState(theta, self._stored(theta), angle_rad, axial_mm)

    def step(
        self, state: FullState, power_kw: float, traverse_mm_per_s: float, axial_mm: float
    ) -> FullState:
        """State after a step, with the inputs held."""
        h, turning = self.step_s, traverse_mm_per_s / self.parameters.outer_radius_mm
        load = power_kw * self._at(axial_mm)[0]

        def arriving(after_s: float) -> Complex:
            return np.asarray(
                load * np.exp(-1j * self._modes * (state.angle_rad + turning * after_s))[:, None]
            )

        with one_thread():
            first, stored = self._solve(
                state.heat + _GAMMA * h * arriving(_GAMMA * h), state.theta
            )
            flow = (stored - state.heat) / (_GAMMA * h)
            heat = state.heat + (1.0 - _GAMMA) * h * flow + _GAMMA * h * arriving(h)
            theta, stored = self._solve(heat, first)
        return FullState(theta, stored, state.angle_rad + turning * h, axial_mm)

    def _solve(self, heat: Complex, guess: Complex) -> tuple[Complex, Complex]:
        """Theta and the heat that it stores, of a stage.

        ``stored(theta) + gamma h matrix theta = heat``.
        """
        theta = guess
        for _ in range(_MOST_ITERATIONS if self.nonlinear else 1):
            rest = heat - self._beyond_linear(theta)[0] if self.nonlinear else heat
            pairs = [
                factor.solve(np.stack([r.real, r.imag], axis=1))
                for factor, r in zip(self._factors, rest, strict=True)
            ]
            last, theta = theta, np.array([pair[:, 0] + 1j * pair[:, 1] for pair in pairs])
            if np.abs(theta - last).sum(axis=0).max() < _CLOSE_K:
                break
        return theta, self._stored(theta)

    def _stored(self, theta: Complex) -> Complex:
        stored = self._capacity * (self.elements.mass @ theta.T).T
        return np.asarray(stored + self._beyond_linear(theta)[1] if self.nonlinear else stored)

    def _beyond_linear(self, theta: Complex) -> tuple[Complex, Complex]:
        """Stored heat beyond the linear one, with and without a stage's loss by radiation."""
        p, count = self.parameters, 3 * self._modes.size
        values = np.fft.irfft(theta * count, n=count, axis=0)
        temperature_c = self.copper.temperature_c(values)
        heat = self.copper.heat(temperature_c) - self._capacity * values
        air, hot = p.ambient_c + ZERO_C, temperature_c + ZERO_C
        flux = p.convection_w_per_m2_k * (hot - air) + p.emissivity * STEFAN_BOLTZMANN * (
            hot**4 - air**4
        )
        flux -= p.surface_w_per_m2_k * values
        clamped = p.clamp_w_per_m2_k * (hot - air - values)

        def modes(nodes: Array) -> Complex:
            return np.asarray(np.fft.rfft(nodes, axis=0)[: self._modes.size] / count)

        e = self.elements
        stored = (e.mass @ modes(heat).T).T
        lost = (e.surface @ modes(flux).T + e.clamp @ modes(clamped).T).T
        return stored + _GAMMA * self.step_s * lost, stored

    def _at(self, axial_mm: float) -> tuple[Array, Array]:
        if axial_mm not in self._loads:
            self._loads[axial_mm] = _load_and_rim(self.elements, axial_mm)
        return self._loads[axial_mm]

    def stir_zone_temperature_c(self, state: FullState) -> float:
        """Mean temperature at the probe's rim, of theta's mean."""
        phase = np.exp(1j * self._modes * state.angle_rad)
        return float(
            self.copper.temperature_c(
                (phase @ (self._at(state.axial_mm)[1] * state.theta).sum(axis=1)).real
            )
        )

    def temperature_c(
        self, state: FullState, radius_mm: ArrayLike, angle_rad: ArrayLike, axial_mm: ArrayLike
    ) -> Array:
        """Temperatures at n points of the copper."""
        r, angle, z = (
            np.ravel(column) for column in np.broadcast_arrays(radius_mm, angle_rad, axial_mm)
        )
        at = self.elements.at(1e-3 * r, 1e-3 * z) @ (
            state.theta.T * np.where(self._modes == 0, 1.0, 2.0)
        )
        return np.asarray(
            self.copper.temperature_c(
                (at * np.exp(1j * np.outer(angle, self._modes))).sum(axis=1).real
            )
        )

    def stored_j(self, state: FullState) -> float:
        """Heat in the copper since ambient."""
        return float(2.0 * pi * state.heat[0].real.sum())


def _matrix(elements: Elements, mode: int) -> Any:
    """Conduction, and linear losses to air and clamp, of a mode."""
    p = elements.parameters
    losses = p.surface_w_per_m2_k * elements.surface + p.clamp_w_per_m2_k * elements.clamp
    return p.conductivity_w_per_m_k * elements.stiffness(mode) + losses


def _load_and_rim(elements: Elements, axial_mm: float) -> tuple[Array, Array]:
    """Load of 1 kW and mean at the rim, of every mode, for a position; each (modes, size)."""
    p, z = elements.parameters, 1e-3 * axial_mm
    modes = p.modes + 1
    load = (1.0 - p.shoulder_share) * elements.functional(elements.probe(z), modes)
    load += p.shoulder_share * elements.functional(elements.shoulder(z), modes)
    rim = elements.functional(elements.rim(z), modes)
    rim[1:] *= 2.0
    return load * (1e3 * (1.0 - p.tool_share) / (2.0 * pi)), rim


def exact_stir_zone_c(
    parameters: CanisterParameters,
    course: ToolCourse,
    dt_s: float,
    progress: Callable[[float], None] | None = None,
) -> Array:
    """Stir-zone temperature at the ends of the steps, from cold, by all finite elements.

    The linear equations are solved exactly for inputs that are held for a step, as in the reduced
    model, but with all eigenvectors of a mode and with the loads of each position instead of a
    table.
    """
    from scipy.linalg import eigh

    elements, size = Elements(parameters), course.power_kw.size
    heights_mm, height = np.unique(course.axial_mm, return_inverse=True)
    loads, rims = map(
        np.array, zip(*(_load_and_rim(elements, float(z)) for z in heights_mm), strict=True)
    )
    speeds, speed = np.unique(
        course.traverse_mm_per_s / parameters.outer_radius_mm, return_inverse=True
    )
    angle = np.concatenate([[0.0], np.cumsum(speeds[speed] * dt_s)])
    mass, theta = parameters.heat_capacity_j_per_m3_k * elements.mass.toarray(), np.zeros(size)
    for mode in range(parameters.modes + 1):
        with one_thread():
            decay, vectors = eigh(_matrix(elements, mode).toarray(), mass)
        load, rim = loads[:, mode] @ vectors, rims[:, mode] @ vectors
        kept = np.exp(-decay * dt_s)
        rates = decay - 1j * mode * speeds[:, None]
        still = np.abs(rates) * dt_s < 1e-9
        arrived = np.exp(-1j * mode * speeds[:, None] * dt_s) - kept
        response = np.where(still, dt_s, arrived / np.where(still, 1.0, rates))
        phase, state = np.exp(1j * mode * angle), np.zeros(decay.size, complex)
        for k in range(size):
            state = kept * state + (course.power_kw[k] / phase[k]) * (
                response[speed[k]] * load[height[k]]
            )
            theta[k] += (phase[k + 1] * (rim[height[k]] @ state)).real
        if progress is not None:
            progress((mode + 1) / (parameters.modes + 1))
    return Kirchhoff(parameters).temperature_c(theta)
