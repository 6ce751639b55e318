"""One plant in C: drives, process and sensors; on a canister, its process is in Python."""

from __future__ import annotations

from typing import Any

from fsw_control import Command
from fsw_model import Equilibrium, OperatingPointError, Outputs, OutsideModelError, ProcessState
from fsw_plant.canister_process import CanisterProcessState
from fsw_plant.config import PlantConfig
from fsw_plant.library import KERNEL, configure, configure_machine, model_of
from fsw_plant.process import canister_process, process_model
from fsw_plant.sensors import BLOCK, Draws, sensors_of
from fsw_plant.tool_path import Motion


class PlantCore:
    """Drives, process and sensors of a plant; disturbances are set by the caller in ``added``.

    ``memory``, a ``fsw_plant *`` (``kernel/fsw_plant.h``), is the state of all but the process on
    a canister: state ``x`` of the process, its power within the dead time, drives and sensors. It
    may be read and changed between ticks, to test or to disturb the plant.
    """

    state: ProcessState  #: of the process on a canister; otherwise the state at the start

    def __init__(self, config: PlantConfig) -> None:
        ffi = KERNEL.ffi
        self.memory = KERNEL.new("fsw_plant")
        self.added = KERNEL.new("fsw_plant_disturbance")  #: disturbances in the present tick
        self.model, self._canister = model_of(config.model), canister_process(config)
        self._outputs = ffi.cast("double *", ffi.addressof(self.memory, "outputs"))
        self.sensors = sensors_of(config)  #: their names
        self._shown = ffi.new("double[]", len(self.sensors))
        self._command = ffi.new("double[2]")
        self._inputs = KERNEL.new("fsw_plant_inputs")

    def equilibrium(
        self, config: PlantConfig, depth_mm: float, temperature_c: float, motion: Motion
    ) -> Equilibrium:
        """Start of a weld; raises OperatingPointError if there is none."""
        if self._canister is None:
            return process_model(config.model).equilibrium(depth_mm, temperature_c)
        return self._canister.start(depth_mm, temperature_c, config["start.power_kw"], motion)

    def start(
        self, config: PlantConfig, depth_mm: float, temperature_c: float, start: Equilibrium
    ) -> None:
        """Restart from ``start``, without disturbances."""
        configure(self.memory, config)
        configure_machine(self.memory, config, config["seed"])
        lib, self.added[0] = KERNEL.lib, KERNEL.new("fsw_plant_disturbance")[0]
        if self._canister is None:
            lib.fsw_plant_start(self.memory, self.model, depth_mm, temperature_c)
        else:
            lib.fsw_plant_begin(self.memory, self.model, start.state.x, config["start.power_kw"])
        self.state = start.state.copy()
        self._draws, self._n_drawn = Draws(config["seed"], len(self.sensors)), 0
        self._drawn: Any = None  # the present block of numbers

    def reconfigure(self, config: PlantConfig, other_model: bool) -> None:
        """Change settings, and the process if its model changes."""
        if other_model:
            before, self.model = self.model.delay_steps, model_of(config.model)
            KERNEL.lib.fsw_plant_refit(self.memory, before, self.model.delay_steps)
            self._canister = canister_process(config)
            if self._canister is not None:
                assert isinstance(self.state, CanisterProcessState)
                self._canister.refit(self.state)
        configure(self.memory, config)

    @property
    def acting(self) -> Command:
        """Acting inputs as the drives report them."""
        return Command(*KERNEL.ffi.unpack(self.memory.acting, 2))

    @property
    def outputs(self) -> Outputs:
        """Outputs of the process, without disturbances and noise."""
        return Outputs(*KERNEL.ffi.unpack(self._outputs, len(Outputs._fields)))

    @property
    def angle_deg(self) -> float:
        """Angle about the canister that the tool has travelled."""
        return 360.0 * self.travel_mm / float(self.memory.machine.circumference_mm)

    @property
    def travel_mm(self) -> float:
        """Distance along its path that the tool has travelled."""
        return float(self.memory.machine.travel_mm)

    def measure(self) -> list[float]:
        """Sensor readings, in the order of ``sensors``; call it once per tick."""
        place = self._n_drawn % BLOCK
        if place == 0:
            self._drawn = KERNEL.ffi.from_buffer("double[]", self._draws.block())
        self._n_drawn += 1
        normals = self._drawn + len(self.sensors) * place
        KERNEL.lib.fsw_plant_measure(self.memory, self.added, normals, self._shown)
        return KERNEL.ffi.unpack(self._shown, len(self.sensors))  # type: ignore[no-any-return]

    def advance(self, command: Command, motion: Motion, stopped: bool) -> str:
        """Advance by a tick; returns why the process stands still, empty while it runs."""
        lib, memory, inputs, target = KERNEL.lib, self.memory, self._inputs, self._command
        target[0], target[1] = command
        memory.machine.traverse_mm_per_s = motion.traverse_mm_per_s
        if self._canister is None:
            if lib.fsw_plant_step(memory, self.model, target, self.added):
                return str(OutsideModelError(*memory.left))
            return ""
        words = ""
        lib.fsw_plant_move(memory, target, self.added, inputs)
        if not stopped:
            assert isinstance(self.state, CanisterProcessState)
            try:
                self._canister.advance(
                    self.state, inputs.copper_kn, inputs.mean[1], motion, inputs.added_nm
                )
                memory.x = self.state.x
                lib.fsw_plant_settle(memory, self.model, inputs)
            except OperatingPointError as error:
                words = str(error)
        lib.fsw_plant_heat(memory)
        return words
