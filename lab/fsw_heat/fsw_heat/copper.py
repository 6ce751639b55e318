"""Conductivity and specific heat of pure copper over temperature, and the Kirchhoff transform.

Source: Incropera, DeWitt, Bergman, Lavine, Fundamentals of Heat and Mass Transfer, 6th ed., Table
A.1, "Copper, pure".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fsw_plant.canister import CanisterParameters

Array = NDArray[np.float64]

DENSITY_KG_PER_M3 = 8933.0
TABLE_K = (200.0, 300.0, 400.0, 600.0, 800.0, 1000.0, 1200.0)
CONDUCTIVITY_W_PER_M_K = (413.0, 401.0, 393.0, 379.0, 366.0, 352.0, 339.0)
HEAT_CAPACITY_J_PER_KG_K = (356.0, 385.0, 397.0, 417.0, 433.0, 451.0, 480.0)
_GRID_C = np.arange(-73.0, 1500.0)
#: copper for which the basis is computed [W/(m K), J/(m3 K), W/(m2 K)]; valid for others as well
TYPICAL = {"k": 370.0, "rho_c": 3.8e6, "surface": 20.0, "clamp": 300.0, "shoulder": 0.77}


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
