"""The stir zone's heat with some ninety states in the tool's frame, for any speed and position.

In the frame of the tool an amplitude ``y = x exp(i m angle)`` of the reduced model
(``reduced.py``), with even part u and odd part w about the tool, obeys for the tool's angular
speed s

    u' = -decay u - s m w + b(z) P,    w' = -decay w + s m u,    theta = c(z) u.

Even and odd parts are projected on few vectors each by a Galerkin method: the decay stays
symmetric and the transport skew-symmetric, so the model is stable at every speed. Copper, losses
and clamp enter the small matrices afterwards. Conductivity and specific heat of copper depend on
the temperature; the Kirchhoff transform makes conduction linear.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import isfinite, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fsw_control.schema.models import InputError
from fsw_plant.canister import CanisterParameters
from fsw_plant.library import KERNEL
from fsw_plant.process import CanisterTables

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
#: pure copper: Incropera, DeWitt, Bergman, Lavine, Fundamentals of Heat and Mass Transfer, 6th
#: ed., Table A.1
DENSITY_KG_PER_M3 = 8933.0
TABLE_K = (200.0, 300.0, 400.0, 600.0, 800.0, 1000.0, 1200.0)
CONDUCTIVITY_W_PER_M_K = (413.0, 401.0, 393.0, 379.0, 366.0, 352.0, 339.0)
HEAT_CAPACITY_J_PER_KG_K = (356.0, 385.0, 397.0, 417.0, 433.0, 451.0, 480.0)
_GRID_C = np.arange(-73.0, 1500.0)
#: copper for which the basis is computed [W/(m K), J/(m3 K), W/(m2 K)]; valid for others as well
TYPICAL = {"k": 370.0, "rho_c": 3.8e6, "surface": 20.0, "clamp": 300.0, "shoulder": 0.77}
#: number of step matrices (speed, duration) kept
_MOST_KNOWN = 16


def conductivity(temperature_c: ArrayLike) -> Array:
    """k [W/(m K)], linear between the table's values and constant beyond."""
    return np.interp(np.asarray(temperature_c) + 273.15, TABLE_K, CONDUCTIVITY_W_PER_M_K)


def heat_capacity(temperature_c: ArrayLike) -> Array:
    """c [J/(kg K)], linear between the table's values and constant beyond."""
    return np.interp(np.asarray(temperature_c) + 273.15, TABLE_K, HEAT_CAPACITY_J_PER_KG_K)


class Kirchhoff:
    """Kirchhoff transform: theta = integral of k(T)/k(reference) from ambient to T.

    Conduction is linear in theta. With constant properties theta is T less the ambient
    temperature.
    """

    def __init__(self, parameters: CanisterParameters) -> None:
        p = parameters
        self.linear = p.properties == "constant"
        self.ambient_c = p.ambient_c
        #: temperature, theta, and the heat per volume above ambient, with c(T)
        self.grid_c = np.sort(np.append(_GRID_C, p.ambient_c))
        relative_k = conductivity(self.grid_c) / conductivity(p.reference_c)
        reference_c = heat_capacity(p.reference_c)
        if self.linear:
            relative_k = np.ones_like(relative_k)
        self.theta_k = self._integral(relative_k)
        self.heat_j_per_m3 = p.heat_capacity_j_per_m3_k * self._integral(
            heat_capacity(self.grid_c) / reference_c
        )

    def _integral(self, values: Array) -> Array:
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(self.grid_c)
        total = np.concatenate([[0.0], np.cumsum(steps)])
        return np.asarray(total - np.interp(self.ambient_c, self.grid_c, total))

    def theta(self, temperature_c: ArrayLike) -> Array:
        """Theta [K] for temperatures."""
        return np.asarray(np.interp(np.asarray(temperature_c), self.grid_c, self.theta_k))

    def heat(self, temperature_c: ArrayLike) -> Array:
        """Heat per volume above ambient [J/m3], with c(T)."""
        return np.asarray(np.interp(np.asarray(temperature_c), self.grid_c, self.heat_j_per_m3))

    def temperature_c(self, theta_k: ArrayLike) -> Array:
        """Temperatures for theta."""
        if self.linear:
            return np.asarray(theta_k) + self.ambient_c
        return np.asarray(np.interp(np.asarray(theta_k), self.theta_k, self.grid_c))


@dataclass(frozen=True, slots=True)
class CanisterState:
    """Heat in the canister, and the tool's position."""

    #: amplitudes of theta (:class:`Kirchhoff`) for the model's vectors: complex, or real in the
    #: tool's frame
    modes: Complex | Array
    angle_rad: float = 0.0  #: tool position around the canister from its start
    axial_mm: float = 0.0  #: tool position above the joint line
    power_kw: float = 0.0  #: power of the last step


class HeatModel(ABC):
    """Heat in the canister about the tool, stepped with constant inputs."""

    def __init__(self, parameters: CanisterParameters) -> None:
        self.parameters, self.copper = parameters, Kirchhoff(parameters)

    @abstractmethod
    def initial(self, *, axial_mm: float = 0.0) -> CanisterState:
        """Return a canister at ambient temperature everywhere."""

    def step(
        self,
        state: CanisterState,
        power_kw: float,
        traverse_mm_per_s: float,
        axial_mm: float,
        dt_s: float = 0.1,
    ) -> CanisterState:
        """Return the state after a step with constant inputs.

        The power (24) includes the tool's share; the traverse speed is that at the outer surface,
        negative for backwards; the axial position is relative to the joint line.

        Raises
        ------
        fsw_control.schema.models.InputError
            If an input is not finite, the tool is off the copper or the step is not positive.
        """
        self._check(power_kw, traverse_mm_per_s, axial_mm, dt_s)
        modes = self._driven(state, power_kw, traverse_mm_per_s, axial_mm, dt_s)
        turned = traverse_mm_per_s * dt_s / self.parameters.outer_radius_mm
        return CanisterState(modes, state.angle_rad + turned, axial_mm, power_kw)

    @abstractmethod
    def _driven(
        self,
        state: CanisterState,
        power_kw: float,
        traverse_mm_per_s: float,
        axial_mm: float,
        dt_s: float,
    ) -> Complex | Array:
        """The amplitudes after a step with valid inputs."""

    @abstractmethod
    def stir_zone_temperature_c(self, state: CanisterState) -> float:
        """Mean temperature at the probe's rim, which replaces the copper temperature of (16)."""

    def _check(
        self, power_kw: float, traverse_mm_per_s: float, axial_mm: float, dt_s: float
    ) -> None:
        """Reject invalid inputs of a step."""
        if not isfinite(power_kw + traverse_mm_per_s + axial_mm):
            raise InputError(
                f"canister: power {power_kw} kW, traverse {traverse_mm_per_s} mm/s, "
                f"position {axial_mm} mm: not finite"
            )
        if not 0.0 < dt_s < 1e6:
            raise InputError(f"canister: step of {dt_s} s; must be above 0")
        self.parameters.checked(axial_mm)


@dataclass(frozen=True)
class Compact:
    """Projected matrices, the content of the cache; the even states come first."""

    #: at k = h = 1, (states, states)
    conduction: Array
    surface: Array
    clamp: Array
    transport: Array  #: for one turn of the tool in 2 pi seconds, (even, odd)
    #: as in ``projection.py``, (positions, even), (2, positions) and (positions,)
    probe: Array
    shoulder: Array
    rim: Array
    rest_k_per_w: Array
    axial_mm: Array


class CompactCanister(HeatModel, CanisterTables):
    """The stir zone's heat, stepped exactly for constant power, traverse speed and axial position.

    Parameters and compact model must have the same geometry. The arithmetic is C
    (``kernel/canister.c``), as it is for a plant.
    """

    def __init__(self, parameters: CanisterParameters, compact: Compact) -> None:
        p, q = parameters, compact
        HeatModel.__init__(self, p)
        matrix = p.conductivity_w_per_m_k * q.conduction + p.surface_w_per_m2_k * q.surface
        density = p.heat_capacity_j_per_m3_k
        tables = {
            "decay": (matrix + p.clamp_w_per_m2_k * q.clamp) / density,
            "transport": q.transport,
            "axial_mm": q.axial_mm,
            "source": p.into_copper(q.probe, q.shoulder) / (2.0 * pi * density),
            "rim": q.rim,
            "rest": p.into_copper(*q.rest_k_per_w) * (TYPICAL["k"] / p.conductivity_w_per_m_k),
            "theta_k": self.copper.theta_k,
            "grid_c": self.copper.grid_c,
        }
        CanisterTables.__init__(self, p, tables)
        self._known: dict[tuple[float, float], tuple[Array, Array]] = {}

    def initial(self, *, axial_mm: float = 0.0) -> CanisterState:
        """See :meth:`HeatModel.initial`."""
        return CanisterState(np.zeros(self.states), 0.0, self.parameters.checked(axial_mm))

    def _driven(
        self,
        state: CanisterState,
        power_kw: float,
        traverse_mm_per_s: float,
        axial_mm: float,
        dt_s: float,
    ) -> Complex | Array:
        modes = state.modes.copy()
        transition = map(_pointer, self.over(traverse_mm_per_s, dt_s))
        KERNEL.lib.fsw_plant_canister_step(
            self.memory, *transition, power_kw, axial_mm, _pointer(modes)
        )
        return modes

    def over(self, traverse_mm_per_s: float, dt_s: float) -> tuple[Array, Array]:
        """Transposed transition (states, states) and input matrix of a source (even, states)."""
        key = (traverse_mm_per_s, dt_s)
        if key not in self._known:
            n, even = self.states, len(self.tables["transport"])
            arrays = np.empty((n, n)), np.empty((even, n)), np.empty((3, n, n))
            KERNEL.lib.fsw_plant_canister_over(self.memory, *key, *map(_pointer, arrays))
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[key] = arrays[:2]
        return self._known[key]

    def stir_zone_temperature_c(self, state: CanisterState) -> float:
        """See :meth:`HeatModel.stir_zone_temperature_c`."""
        return float(
            KERNEL.lib.fsw_plant_canister_stir_zone_c(
                self.memory, _pointer(state.modes), state.power_kw, state.axial_mm
            )
        )


def _pointer(array: Array | Complex) -> Any:
    return KERNEL.ffi.from_buffer("double[]", array)
