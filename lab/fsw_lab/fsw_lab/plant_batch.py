"""Many plants in parallel, stepped together: for learning, where single ones are too slow.

Each is identical to a :class:`fsw_plant.emulator.PlantEmulator`, number for number, with the
paper's process, the same settings and disturbances for all, but its own commands and noise. There
are no faults and no watchdog: a command comes at every tick.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_control.schema.models import InputError
from fsw_control.sensors import REQUIRED
from fsw_model import Equilibrium
from fsw_plant import library
from fsw_plant.config import PlantConfig
from fsw_plant.library import BLOCK, KERNEL, Draws
from fsw_plant.process import process_model

Array = NDArray[np.float64]
#: columns of the disturbances, added to outputs, torque and inputs
CHANNELS = tuple(library.CHANNELS)


class PlantBatch:
    """A batch of ``n`` plants.

    Parameters
    ----------
    config : PlantConfig
        With the paper's process.
    n : int
    disturbances : (n_ticks + 1, 6) array
        By tick, in the order of ``CHANNELS``, in mm, degC, N m, kN, rpm, share.
    """

    def __init__(self, config: PlantConfig, n: int, disturbances: Array) -> None:
        if config.machine.depth_channels:
            raise InputError(
                "machine.depth_channels: a plant of a batch has one sensor of the depth"
            )
        self.n, self._disturbances = n, disturbances
        self._model = library.model_of(config.model)
        self._start_at = config["start.depth_mm"], config["start.temperature_c"]
        #: start of each weld
        self.start: Equilibrium = process_model(config.model).equilibrium(*self._start_at)
        limits = config.limits
        self._low = np.array([limits.force_min_kn, limits.speed_min_rpm])
        self._high = np.array([limits.force_max_kn, limits.speed_max_rpm])
        self._plants = KERNEL.ffi.new("fsw_plant[]", n)
        for plant in self._plants:
            library.configure(plant, config)
        self._config = config
        memory = np.frombuffer(KERNEL.ffi.buffer(self._plants), np.uint8).reshape(n, -1)

        def field(name: str, size: int, kind: str = "f8") -> NDArray[Any]:
            first = KERNEL.ffi.offsetof("fsw_plant", name)
            return memory[:, first : first + size * np.dtype(kind).itemsize].view(kind).T

        #: in the order of :class:`fsw_model.Outputs`, (7, n), without disturbances and noise
        self.outputs = field("outputs", 7)
        self.acting = field("acting", 2)  #: force [kN] and speed [rpm] as the drives report them
        self._stopped = field("stopped", 1, "i4")[0]
        self.tick = np.ones(n, dtype=np.int64)  #: present tick of each plant
        self._drawn = np.empty((n, BLOCK, len(REQUIRED)))
        self._draws = [Draws(0) for _ in range(n)]
        self.reset(np.arange(n), np.zeros(n, dtype=np.int64))

    @property
    def stopped(self) -> NDArray[np.bool_]:
        """The tool has left the model's range of validity; the process then stands still."""
        return self._stopped != 0

    def reset(self, which: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        """Restart with new seeds of the noise."""
        self.tick[which] = 1
        for k, seed in zip(which.tolist(), seeds.tolist(), strict=True):
            plant = KERNEL.ffi.addressof(self._plants, k)
            library.configure_machine(plant, self._config, seed)
            KERNEL.lib.fsw_plant_start(plant, self._model, *self._start_at)
            self._draws[k] = Draws(seed)
            self._drawn[k] = self._draws[k].block()

    def _disturbed(self) -> Array:
        """Disturbances of each plant at its tick, (n, 6)."""
        return np.take(self._disturbances, self.tick, axis=0, mode="clip")

    def truth(self) -> tuple[Array, Array]:
        """Depth [mm] and temperature [degC] of each, disturbances included."""
        depth_mm, temperature_c = self.outputs[:2] + self._disturbed().T[:2]
        return depth_mm, temperature_c

    def measure(self) -> Array:
        """Sensor readings at the present tick; call it once per tick.

        Returns
        -------
        (3, n) array
            In the order of ``REQUIRED``: mm, N m, degC.
        """
        place = (self.tick - 1) % BLOCK
        for k in np.flatnonzero((place == 0) & (self.tick > 1)).tolist():
            self._drawn[k] = self._draws[k].block()
        normals, shown = self._drawn[np.arange(self.n), place], np.empty((self.n, len(REQUIRED)))
        KERNEL.lib.fsw_plant_measure_all(
            self._plants,
            self.n,
            _pointer(self._disturbed(), "fsw_plant_disturbance[]"),
            _pointer(normals),
            _pointer(shown),
        )
        return shown.T

    def step(self, commands: Array) -> None:
        """Advance all plants by a tick with (2, n) commands [kN, rpm], limited as by drives."""
        limited = np.clip(commands.T, self._low, self._high)
        added = _pointer(self._disturbed(), "fsw_plant_disturbance[]")
        KERNEL.lib.fsw_plant_step_all(
            self._plants, self.n, self._model, _pointer(np.ascontiguousarray(limited)), added
        )
        self.tick += 1


def _pointer(array: Array, kind: str = "double[]") -> Any:
    """Pointer to the numbers of a contiguous array, which it keeps alive."""
    return KERNEL.ffi.from_buffer(kind, array)
