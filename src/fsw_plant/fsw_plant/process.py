"""The process of a plant: the paper's, or with heat conduction in a canister."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Protocol

from fsw_canister import CanisterParameters, CompactCanister
from fsw_model import Equilibrium, ModelParameters, Outputs, ProcessModel, ProcessState
from fsw_model.equations import MOTOR, power_kw
from fsw_plant.canister_process import CanisterProcess
from fsw_plant.config import PlantConfig
from fsw_plant.lag import lag_risen
from fsw_plant.tool_path import Motion
from fsw_schema.extensions import loaded
from fsw_schema.models import InputError

#: gets the completed share, and the name of the task
Progress = Callable[[float, str], None]

_reduced: dict[CanisterParameters, CompactCanister] = {}


class PlantProcess(Protocol):
    """Interface of a plant's process."""

    def start(
        self, depth_mm: float, temperature_c: float, power_kw: float, motion: Motion
    ) -> Equilibrium:
        """Start of a weld; on a canister, after heating by ``power_kw`` with this tool motion.

        Raises
        ------
        fsw_model.OperatingPointError
            If there is no such start.
        """

    def advance(
        self,
        state: ProcessState,
        force_kn: float,
        speed_rpm: float,
        motion: Motion,
        added_nm: float = 0.0,
    ) -> None:
        """Advance ``state`` in place by a step; ``added_nm`` is added to M_sp in (18).

        Raises
        ------
        fsw_model.OperatingPointError
            If the shoulder or the tool would leave the copper, or an input is not finite.
        """

    def outputs(self, state: ProcessState, force_kn: float, speed_rpm: float) -> Outputs:
        """Outputs in a state under given inputs."""

    def refit(self, state: ProcessState) -> None:
        """Convert a state of other parameters, with its history within the dead time."""


class PaperProcess:
    """The paper's process (5)-(27), a :class:`PlantProcess`; it starts in equilibrium."""

    def __init__(self, parameters: ModelParameters) -> None:
        self._model = ProcessModel(parameters)
        self.outputs = self._model.outputs

    def start(
        self, depth_mm: float, temperature_c: float, power_kw: float, motion: Motion
    ) -> Equilibrium:
        """See :class:`PlantProcess`."""
        return self._model.equilibrium(depth_mm, temperature_c)

    def advance(
        self,
        state: ProcessState,
        force_kn: float,
        speed_rpm: float,
        motion: Motion,
        added_nm: float = 0.0,
    ) -> None:
        """See :class:`PlantProcess`."""
        self._model.step(state, force_kn, speed_rpm)
        if added_nm:
            lag_s = self._model.parameters.motor_lag_s
            state.x = (*state.x[:MOTOR], state.x[MOTOR] + lag_risen(lag_s) * added_nm)
            # the added torque rises within the step as 1 - exp(-s / lag): the first and the last
            # function of the power
            more_kw = power_kw(added_nm, speed_rpm)
            constant, linear, square, fading = state.power[-1]
            state.power[-1] = (constant + more_kw, linear, square, fading - more_kw)

    def refit(self, state: ProcessState) -> None:
        """See :class:`PlantProcess`."""
        state.power = self._model.with_history(state.power)


def process_of(config: PlantConfig) -> PlantProcess:
    """The process of a plant."""
    if config.canister is None:
        return _paper_process(config.model)
    return CanisterProcess(config.model, reduced(config.canister))


def prepare(config: PlantConfig, progress: Progress | None = None) -> None:
    """Prepare what is slow before the first tick: for a canister, its compact model."""
    if config.canister is not None:
        reduced(config.canister, progress)


@lru_cache(maxsize=16)
def _paper_process(parameters: ModelParameters) -> PaperProcess:
    """The paper's process for these parameters, cached: it takes a tenth of a second to make."""
    return PaperProcess(parameters)


def reduced(parameters: CanisterParameters, progress: Progress | None = None) -> CompactCanister:
    """The compact canister model, cached; a new geometry takes a while, with progress reports.

    Raises
    ------
    fsw_schema.models.InputError
        If no installed distribution makes it.
    """
    if parameters not in _reduced:
        make = loaded("fsw.processes", "canister")
        if make is None:
            raise InputError(
                "process canister: nothing here makes its heat model: "
                "pip install 'fsw-lab[canister]'"
            )
        made: CompactCanister = make(parameters, progress=progress)
        _reduced.clear()
        _reduced[parameters] = made
    return _reduced[parameters]
