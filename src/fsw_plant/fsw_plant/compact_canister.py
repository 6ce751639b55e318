"""The heat in a canister with some ninety states in the tool's frame, for the plant in C.

``fsw_heat`` makes the tables (``heat_model.py`` there has the equations).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fsw_plant.canister import CanisterParameters
from fsw_plant.library import KERNEL


class CanisterTables:
    """The compact model of a canister: ``tables`` by the names of ``fsw_plant_canister``."""

    def __init__(
        self, parameters: CanisterParameters, tables: Mapping[str, NDArray[np.float64]]
    ) -> None:
        self.parameters, self.tables = parameters, tables
        self.even, odd = tables["transport"].shape
        self.states = self.even + odd  #: number of real states
        assert self.states <= KERNEL.lib.FSW_PLANT_AMPLITUDES
        self.sizes: dict[str, float] = {
            "states": self.states,
            "even": self.even,
            "positions": len(tables["axial_mm"]),
            "temperatures": len(tables["grid_c"]),
            "radius_mm": parameters.outer_radius_mm,
            "lowest_mm": parameters.lowest_mm,
            "highest_mm": parameters.highest_mm,
        }
        self._buffers = {
            name: KERNEL.ffi.from_buffer("double[]", np.ascontiguousarray(table, dtype=float))
            for name, table in tables.items()
        }
        #: a ``fsw_plant_canister *``, as long as this object lives
        self.memory = KERNEL.new("fsw_plant_canister", **self.sizes, **self._buffers)


class CanisterField:
    """Memory of the heat in a plant's canister; the tool is at ``axial_mm``."""

    def __init__(self, canister: CanisterTables, axial_mm: float) -> None:
        self.canister = canister
        n, even = canister.states, canister.even
        sizes = {"amplitude": n, "kept": n * n, "response": even * n, "work": 3 * n * n}
        self._arrays = {name: KERNEL.ffi.new("double[]", size) for name, size in sizes.items()}
        #: a ``fsw_plant_field *``, as long as this object lives
        self.memory = KERNEL.new(
            "fsw_plant_field", canister=canister.memory, axial_mm=axial_mm, **self._arrays
        )
