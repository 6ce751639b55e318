"""The process models of a plant: the paper's, and heat in the canister."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fsw_control.schema.extensions import loaded
from fsw_control.schema.models import InputError
from fsw_model import ModelParameters, ProcessModel
from fsw_plant.canister import CanisterParameters
from fsw_plant.config import PlantConfig
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


#: gets the completed share, and the name of the task
Progress = Callable[[float, str], None]

_reduced: dict[CanisterParameters, CanisterTables] = {}


def prepare(config: PlantConfig, progress: Progress | None = None) -> None:
    """Prepare slow parts before the first tick: a canister's compact model."""
    if config.canister is not None:
        reduced(config.canister, progress)


@lru_cache(maxsize=16)
def process_model(parameters: ModelParameters) -> ProcessModel:
    """The paper's process for these parameters, cached: it takes a tenth of a second to make."""
    return ProcessModel(parameters)


def reduced(parameters: CanisterParameters, progress: Progress | None = None) -> CanisterTables:
    """The compact canister model, cached; a new geometry takes a while, with progress reports.

    Raises
    ------
    fsw_control.schema.models.InputError
        If no installed distribution makes it.
    """
    if parameters not in _reduced:
        make = loaded("fsw.processes", "canister")
        if make is None:
            raise InputError(
                "process canister: nothing here makes its heat model: "
                "pip install 'fsw-lab[canister]'"
            )
        made: CanisterTables = make(parameters, progress=progress)
        _reduced.clear()
        _reduced[parameters] = made
    return _reduced[parameters]
