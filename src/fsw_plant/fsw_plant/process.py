"""The plant's process: the paper's model, or a canister's heat instead of (16)."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from fsw_control.schema.extensions import loaded
from fsw_control.schema.models import InputError
from fsw_model import ModelParameters, ProcessModel
from fsw_plant.canister import CanisterParameters
from fsw_plant.compact_canister import CanisterTables
from fsw_plant.config import PlantConfig

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
