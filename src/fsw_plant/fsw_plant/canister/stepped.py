"""Common base of the canister's heat models: state, tool position and checked inputs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fsw_control.schema.models import InputError
from fsw_plant.canister.copper import Array, Kirchhoff
from fsw_plant.canister.parameters import CanisterParameters

Complex = NDArray[np.complex128]
#: longest heating-up before the first tick, chosen
LONGEST_HEATING_S = 1800.0


@dataclass(frozen=True, slots=True)
class CanisterState:
    """Heat in the canister, and the tool's position."""

    #: amplitudes of theta (``copper.py``) for the model's vectors: complex, or real in the tool's
    #: frame
    modes: Complex | Array
    angle_rad: float = 0.0  #: tool position around the canister from its start
    axial_mm: float = 0.0  #: tool position above the joint line
    power_kw: float = 0.0  #: power of the last step

    def copy(self) -> CanisterState:
        """Independent copy."""
        return replace(self, modes=self.modes.copy())


class HeatModel(ABC):
    """Heat in the canister about the tool, stepped with constant inputs.

    Parameters
    ----------
    parameters : CanisterParameters
    axial_mm : (positions,) array
        Evenly spaced positions of the following tables.
    source, rim : (positions, n) arrays
        Heat of 1 kW into the states, and the stir zone's temperature by the states.
    rest_k_per_kw : (positions,) array
        Direct feedthrough from power to temperature.
    """

    def __init__(
        self,
        parameters: CanisterParameters,
        axial_mm: Array,
        source: Array,
        rim: Array,
        rest_k_per_kw: Array,
    ) -> None:
        self.parameters, self.copper = parameters, Kirchhoff(parameters)
        self._axial_mm, self._source, self._rim, self._rest = axial_mm, source, rim, rest_k_per_kw
        self._table = (float("nan"), (np.zeros(0), np.zeros(0), 0.0))

    @abstractmethod
    def initial(self, *, axial_mm: float = 0.0) -> CanisterState:
        """Return a canister at ambient temperature everywhere."""

    @abstractmethod
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

    @abstractmethod
    def stir_zone_temperature_c(self, state: CanisterState) -> float:
        """Mean temperature at the probe's rim, which replaces the copper temperature of (16)."""

    def _checked(self, axial_mm: float) -> float:
        low, high = self.parameters.lowest_mm, self.parameters.highest_mm
        if not low - 1e-9 <= axial_mm <= high + 1e-9:
            raise InputError(
                f"canister: tool at {axial_mm:g} mm is off the copper; "
                f"{low:g} to {high:g} mm above the joint"
            )
        return axial_mm

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

    def _at(self, axial_mm: float) -> tuple[Array, Array, float]:
        """Source, rim and feedthrough at a position, by cubic interpolation of the tables."""
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
            self._table = (
                axial_mm,
                (weights @ self._source[near], weights @ self._rim[near], rest),
            )
        return self._table[1]


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
    for _ in range(round(LONGEST_HEATING_S / dt_s)):
        if (rest_c := missing_c(state)) <= 0.0:
            return state
        state = canister.step(state, power_kw, traverse, axial_mm, dt_s)
    raise InputError(
        f"{power_kw:g} kW leave {rest_c:.1f} degC missing after {LONGEST_HEATING_S:g} s of heating"
    )
