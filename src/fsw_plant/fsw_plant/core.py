"""One plant in C: drives, process and sensors."""

from __future__ import annotations

from collections import deque
from typing import Any

from fsw_control import Command
from fsw_control.schema.models import InputError
from fsw_model import Equilibrium, OperatingPointError, Outputs, OutsideModelError, ProcessState
from fsw_plant.config import PlantConfig
from fsw_plant.library import (
    BLOCK,
    KERNEL,
    Draws,
    configure,
    configure_machine,
    model_of,
    sensors_of,
)
from fsw_plant.process import CanisterField, process_model, reduced
from fsw_plant.tool_path import Motion


class PlantCore:
    """Drives, process and sensors of a plant; disturbances are set by the caller in ``added``.

    ``memory``, a ``fsw_plant *`` (``kernel/fsw_plant.h``), is the state: ``x`` of the process, its
    power within the dead time, drives and sensors, and the heat in a canister. It may be read and
    changed between ticks, to test or to disturb the plant.
    """

    field: CanisterField | None = None  #: of the heat in the canister
    _heated: CanisterField | None = None  #: the one that :meth:`equilibrium` heated, for a start

    def __init__(self, config: PlantConfig) -> None:
        ffi = KERNEL.ffi
        self.memory = KERNEL.new("fsw_plant")
        self.added = KERNEL.new("fsw_plant_disturbance")  #: disturbances in the present tick
        self.model = model_of(config.model)
        self.sensors = sensors_of(config)  #: their names
        self._outputs = _first_output(self.memory)
        self._shown = ffi.new("double[]", len(self.sensors))
        self._command = ffi.new("double[2]")

    def equilibrium(
        self, config: PlantConfig, depth_mm: float, temperature_c: float, motion: Motion
    ) -> Equilibrium:
        """Start of a weld; raises OperatingPointError if there is none."""
        if config.canister is None:
            return process_model(config.model).equilibrium(depth_mm, temperature_c)
        lib, plant, power_kw = KERNEL.lib, KERNEL.new("fsw_plant"), config["start.power_kw"]
        field = CanisterField(reduced(config.canister), motion.axial_mm)
        plant.field, plant.machine.traverse_mm_per_s = field.memory, motion.traverse_mm_per_s
        start = f"start at {temperature_c:g} degC"
        why = lib.fsw_plant_heat_up(
            plant, model_of(config.model), depth_mm, temperature_c, power_kw
        )
        if why == lib.FSW_PLANT_LEFT:
            raise OperatingPointError(
                f"no start at depth {depth_mm:.4g} mm, {temperature_c:.4g} degC (27)"
            )
        if why == lib.FSW_PLANT_COLD:
            raise OperatingPointError(
                f"{start}: {power_kw:g} kW leave {plant.left[0]:.1f} degC missing after "
                f"{lib.FSW_PLANT_LONGEST_S} s of heating; raise start.power_kw"
            )
        if why:
            raise OperatingPointError(f"{start}: {_off_copper(field)}")
        self._heated, state = field, ProcessState(tuple(plant.x), deque())
        force_kn, speed_rpm = plant.acting
        return Equilibrium(force_kn, speed_rpm, _outputs_at(_first_output(plant)), state)

    def start(
        self, config: PlantConfig, depth_mm: float, temperature_c: float, start: Equilibrium
    ) -> None:
        """Restart from ``start``, without disturbances."""
        configure(self.memory, config)
        configure_machine(self.memory, config, config["seed"])
        lib, self.added[0] = KERNEL.lib, KERNEL.new("fsw_plant_disturbance")[0]
        if self._heated is None:
            lib.fsw_plant_start(self.memory, self.model, depth_mm, temperature_c)
        else:
            self.field, self.memory.field = self._heated, self._heated.memory
            lib.fsw_plant_begin(self.memory, self.model, start.state.x, config["start.power_kw"])
        self._draws, self._n_drawn = Draws(config["seed"], len(self.sensors)), 0
        self._drawn: Any = None  # the present block of numbers

    def reconfigure(self, config: PlantConfig, other_model: bool) -> None:
        """Change settings, and the process if its model changes."""
        if other_model:
            before, self.model = self.model.delay_steps, model_of(config.model)
            KERNEL.lib.fsw_plant_refit(self.memory, before, self.model.delay_steps)
        configure(self.memory, config)

    @property
    def acting(self) -> Command:
        """Acting inputs as the drives report them."""
        return Command(*KERNEL.ffi.unpack(self.memory.acting, 2))

    @property
    def outputs(self) -> Outputs:
        """Outputs of the process, without disturbances and noise."""
        return _outputs_at(self._outputs)

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
        # by the number of readings, not by what was shown: a tick has the same noise whatever
        # faults, settings or disturbances did before it
        place = self._n_drawn % BLOCK
        if place == 0:
            self._drawn = KERNEL.ffi.from_buffer("double[]", self._draws.block())
        self._n_drawn += 1
        normals = self._drawn + len(self.sensors) * place
        KERNEL.lib.fsw_plant_measure(self.memory, self.added, normals, self._shown)
        return KERNEL.ffi.unpack(self._shown, len(self.sensors))  # type: ignore[no-any-return]

    def advance(self, command: Command, motion: Motion) -> str:
        """Advance by a tick; returns why the process stands still, empty while it runs."""
        memory, target = self.memory, self._command
        target[0], target[1] = command
        memory.machine.traverse_mm_per_s = motion.traverse_mm_per_s
        if self.field is not None:
            self.field.memory.axial_mm = motion.axial_mm
        why = KERNEL.lib.fsw_plant_step(memory, self.model, target, self.added)
        if not why:
            return ""
        if self.field is not None and why == KERNEL.lib.FSW_PLANT_OFF_COPPER:
            return _off_copper(self.field)
        return str(OutsideModelError(*memory.left))


def _first_output(plant: Any) -> Any:
    """Where the outputs of the process of a ``fsw_plant *`` begin."""
    return KERNEL.ffi.cast("double *", KERNEL.ffi.addressof(plant, "outputs"))


def _outputs_at(first: Any) -> Outputs:
    return Outputs(*KERNEL.ffi.unpack(first, len(Outputs._fields)))


def _off_copper(field: CanisterField) -> str:
    """That the tool is off the copper, and where that is."""
    try:
        field.canister.parameters.checked(field.memory.axial_mm)
    except InputError as error:
        return str(error)
    return ""
