"""Many plants in parallel, stepped together: for learning, where single ones are too slow.

Each is identical to a :class:`fsw_plant.emulator.PlantEmulator`, number for number, with the
paper's process, the same settings and disturbances for all, but its own commands and noise. There
are no faults and no watchdog: a command comes at every tick.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from fsw_control import weld
from fsw_control.sensors import REQUIRED
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_model import STEP_S, Equilibrium, ProcessModel
from fsw_model.equations import MOTOR, N_POWER, power_kw
from fsw_plant.config import PlantConfig
from fsw_plant.lag import lag_left, lag_mean, lag_risen
from fsw_plant.sensors import BLOCK, noise_of

Array = NDArray[np.float64]
#: columns of the disturbances, added to outputs, torque and inputs
CHANNELS = ("depth", "temperature", "torque", "axial_force", "spindle_speed")


class PlantBatch:
    """A batch of ``n`` plants.

    Parameters
    ----------
    config : PlantConfig
        With the paper's process.
    n : int
    disturbances : (n_ticks + 1, 5) array
        By tick, in the order of ``CHANNELS``, in mm, degC, N m, kN, rpm.
    """

    def __init__(self, config: PlantConfig, n: int, disturbances: Array) -> None:
        self.config, self.n, self._disturbances = config, n, disturbances
        self._model = model = ProcessModel(config.model)
        self._start = model.equilibrium(config["start.depth_mm"], config["start.temperature_c"])
        limits, lag_s = config.limits, config["actuators.lag_s"]
        self._low = np.array([[limits.force_min_kn], [limits.speed_min_rpm]])
        self._high = np.array([[limits.force_max_kn], [limits.speed_max_rpm]])
        self._largest = np.array([[limits.force_step_kn], [limits.speed_step_rpm]])
        self._left, self._mean = lag_left(lag_s), lag_mean(lag_s)
        self._probe_lag_s = config["sensors.temperature_lag_s"]
        self._step_all = _Mapped(model.step_function, n)
        self._outputs_all = _Mapped(model.output_function, n)
        self._noise = [noise_of(config)[name] for name in REQUIRED]
        self.tick = np.ones(n, dtype=np.int64)  #: present tick of each plant
        self._x = np.empty((6, n))
        self.outputs = np.empty(
            (7, n)
        )  #: in the order of :class:`fsw_model.Outputs`, without disturbances and noise
        self._power = np.empty((model.delay_steps, N_POWER, n))
        self._oldest = 0  # row of the power that arrives now, for all plants
        self._setpoint, self.position = np.empty((2, n)), np.empty((2, n))
        self.acting = np.empty((2, n))  #: force [kN] and speed [rpm] as the drives report them
        self._on_the_way = np.empty((config["actuators.dead_time_ticks"], 2, n))
        self._inertia_nm = np.zeros(n)
        #: the tool has left the model's range of validity; the process then stands still
        self.stopped = np.zeros(n, dtype=bool)
        self._drawn = np.empty((len(REQUIRED), n, BLOCK))
        self._deviations = np.zeros(
            (len(REQUIRED), n)
        )  # what the noise is at, in standard deviations
        self._probe_c = np.empty(n)
        self._generators = [
            [np.random.Generator(np.random.PCG64())] * len(REQUIRED) for _ in range(n)
        ]
        self.reset(np.arange(n), np.zeros(n, dtype=np.int64))

    @property
    def start(self) -> Equilibrium:
        """Start of each weld."""
        return self._start

    def reset(self, which: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        """Restart with new seeds of the noise."""
        start = self._start
        self.tick[which] = 1
        self._x[:, which] = np.array(start.state.x)[:, None]
        self._power[:, :, which] = np.array(start.state.power)[:, :, None]
        inputs = np.array([[start.force_kn], [start.speed_rpm]])
        for array in (self._setpoint, self.position, self.acting):
            array[:, which] = inputs
        self._on_the_way[:, :, which] = inputs
        self.outputs[:, which] = np.array(start.outputs)[:, None]
        self._probe_c[which] = start.outputs.temperature_c
        self._inertia_nm[which], self.stopped[which] = 0.0, False
        for k, seed in zip(which.tolist(), seeds.tolist(), strict=True):
            self._generators[k] = [
                np.random.Generator(np.random.PCG64([seed, i])) for i in range(len(REQUIRED))
            ]
        self._draw(which)

    def _draw(self, which: NDArray[np.int64]) -> None:
        """Draw random numbers for the next ticks, as each sensor of a single plant does."""
        for k in which.tolist():
            for i, generator in enumerate(self._generators[k]):
                self._drawn[i, k] = generator.standard_normal(BLOCK)

    def _disturbed(self, channel: str) -> Array:
        """Value of a disturbance in each plant at its tick."""
        row: Array = self._disturbances[:, CHANNELS.index(channel)]
        return row[np.minimum(self.tick, len(row) - 1)]

    def truth(self) -> tuple[Array, Array]:
        """Depth [mm] and temperature [degC] of each, disturbances included."""
        return self.outputs[0] + self._disturbed("depth"), self.outputs[1] + self._disturbed(
            "temperature"
        )

    def measure(self) -> Array:
        """Sensor readings at the present tick; call it once per tick.

        Returns
        -------
        (3, n) array
            In the order of ``REQUIRED``: mm, N m, degC.
        """
        place = (self.tick - 1) % BLOCK
        used_up = np.flatnonzero((place == 0) & (self.tick > 1))
        if used_up.size:
            self._draw(used_up)
        depth, temperature = self.truth()
        if self._probe_lag_s:
            temperature = self._probe_c
        drop_nm = self.config["sensors.torque_drop_nm_per_rpm"] * (self.acting[1] - weld.SPEED_RPM)
        shown = np.stack([depth, self.outputs[3] + self._inertia_nm - drop_nm, temperature])
        every = np.arange(self.n)
        for i, noise in enumerate(self._noise):
            fresh, kept = self._drawn[i, every, place], noise.autocorrelation
            later = kept * self._deviations[i] + sqrt(1.0 - kept**2) * fresh
            self._deviations[i] = np.where(self.tick == 1, fresh, later)
            shown[i] += noise.deviation * self._deviations[i]
            if noise.resolution > 0.0:
                shown[i] = np.rint(shown[i] / noise.resolution) * noise.resolution
        return shown

    def step(self, commands: Array) -> None:
        """Advance all plants by a tick with (2, n) commands [kN, rpm], limited as by drives."""
        target = np.minimum(np.maximum(commands, self._low), self._high)
        if len(self._on_the_way):
            first = self._on_the_way[0].copy()
            self._on_the_way[:-1] = self._on_the_way[1:]
            self._on_the_way[-1], target = target, first
        self._setpoint += np.clip(target - self._setpoint, -self._largest, self._largest)
        behind = self.position - self._setpoint
        self.position = self._setpoint + behind * self._left
        mean = self._setpoint + behind * self._mean
        disturbance = np.stack([self._disturbed("axial_force"), self._disturbed("spindle_speed")])
        before = (self.truth()[1], self.outputs[1]) if self._probe_lag_s else None
        self._advance(mean + disturbance, self.position + disturbance)
        if before:
            held_c, process_c = before
            left, late = lag_left(self._probe_lag_s), lag_mean(self._probe_lag_s)
            self._probe_c = (
                held_c
                + left * (self._probe_c - held_c)
                + (1.0 - late) * (self.outputs[1] - process_c)
            )
        self.tick += 1

    def _advance(self, mean: Array, end: Array) -> None:
        oldest, newer = self._oldest, (self._oldest + 1) % len(self._power)
        after = self._step_all(
            self._x, self._power[oldest], self._power[newer], mean[:1], mean[1:]
        )
        moved, sent, depth = after[:6], after[6:10], after[10]
        fine = (depth > 0.0) & np.isfinite(after[6]) & ~self.stopped
        self.stopped = ~fine
        added_nm = self._disturbed("torque")
        moved[MOTOR] += lag_risen(self.config.model.motor_lag_s) * added_nm
        more_kw = power_kw(added_nm, mean[1])
        sent[0] += more_kw
        sent[3] -= more_kw
        self._x = np.where(fine, moved, self._x)
        self._power[oldest] = np.where(fine, sent, self._power[oldest])
        self._oldest = newer
        self.outputs = np.where(fine, self._outputs_all(self._x, end[:1], end[1:]), self.outputs)
        acceleration = (end[1] - self.acting[1]) / STEP_S
        inertia = self.config.model.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * acceleration
        self._inertia_nm = np.where(fine, inertia, self._inertia_nm)
        self.acting = np.where(fine, end, self.acting)


class _Mapped:
    """A CasADi function of columns, for ``n`` columns at once."""

    def __init__(self, function: object, n: int) -> None:
        self._function = function.map(n)  # type: ignore[attr-defined]
        sizes = [self._function.size_in(i) for i in range(self._function.n_in())]
        self._given = [np.zeros(size, order="F") for size in sizes]
        self._result = [
            np.zeros(self._function.size_out(i), order="F") for i in range(self._function.n_out())
        ]
        self._buffer, self._evaluate = self._function.buffer()
        for i, array in enumerate(self._given):
            self._buffer.set_arg(i, array.ravel(order="K").data)
        for i, array in enumerate(self._result):
            self._buffer.set_res(i, array.ravel(order="K").data)

    def __call__(self, *values: Array) -> Array:
        """All results stacked, (rows, n)."""
        for array, value in zip(self._given, values, strict=True):
            array[...] = value
        self._evaluate()
        return np.concatenate(self._result)
