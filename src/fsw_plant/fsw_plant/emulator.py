"""The plant emulator: the process with its drives, sensors, disturbances, faults and watchdog, one tick at a time.

Use, per tick (see also :class:`Reading`)::

    plant = PlantEmulator(PlantConfig.from_values({"seed": 1, "start": {"depth_mm": 2.7}}),
                          PlantSchedule.from_events(scenario["events"]))
    while True:
        reading = plant.measure()           # state before this tick's command acts
        refusal = plant.apply(command)      # "" when obeyed; holds from this tick until the next one
        plant.step()                        # 0.1 s on

Tick k has the time ``k * 0.1 s``. The first tick is 1, because a stamp of zero means "no time" in ROS. A scheduled
event acts on the first tick that is not before it: output disturbances and faults on what is measured at that tick,
input disturbances on the step that begins there.

Units: mm, degC, N m, kN, rpm, s; stamps in ns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import isfinite, nan

from fsw_control import SENSORS, Command, Measurement, weld
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_model import (
    STEP_S,
    Equilibrium,
    ModelParameters,
    OperatingPointError,
    Outputs,
    ProcessModel,
    ProcessState,
)
from fsw_plant.actuators import Actuator
from fsw_plant.commands import CommandGate
from fsw_plant.config import PlantConfig
from fsw_plant.disturbances import OUTPUT_CHANNELS, Disturbance, Disturbances
from fsw_plant.faults import Fault, Faults, Sample
from fsw_plant.schedule import PlantSchedule
from fsw_plant.sensors import NoisySensor
from fsw_plant.watchdog import Watchdog, WatchdogState

TICK_NS = 100_000_000
FIRST_TICK = 1


@dataclass(frozen=True, slots=True)
class Reading:
    """What the sensors send at one tick.

    Attributes
    ----------
    tick : int
    stamp_ns : int
        Stamp of the tick.
    depth_mm, torque_nm, temperature_c : tuple of Sample
        One sample each while the sensor works; none when it drops out, two when it duplicates, one with an older
        stamp when it is late.
    drives : Command
        Inputs that act, as the drives report them: input disturbances included, as a load cell sees them.
    """

    tick: int
    stamp_ns: int
    depth_mm: tuple[Sample, ...]
    torque_nm: tuple[Sample, ...]
    temperature_c: tuple[Sample, ...]
    drives: Command

    def measurement(self) -> Measurement:
        """This tick's samples as a measurement; what did not come or is not finite is invalid."""
        values = []
        for samples in (self.depth_mm, self.torque_nm, self.temperature_c):
            values.append(next((sample.value for sample in samples if sample.stamp_ns == self.stamp_ns), nan))
        depth, torque, temperature = values
        depth_valid, torque_valid, temperature_valid = (isfinite(value) for value in values)
        drives = self.drives
        return Measurement(
            self.stamp_ns * 1e-9,
            depth,
            torque,
            temperature,
            depth_valid,
            torque_valid,
            temperature_valid,
            force_kn=drives.force_kn,
            speed_rpm=drives.speed_rpm,
        )


@dataclass(frozen=True, slots=True)
class Truth:
    """The plant as it is, without noise and faults; for analysis only. Units in the names."""

    tick: int
    stamp_ns: int
    depth_mm: float
    temperature_c: float
    copper_temperature_c: float
    motor_torque_nm: float
    process_torque_nm: float
    friction_torque_nm: float
    process_power_kw: float
    force_kn: float
    speed_rpm: float
    depth_disturbance_mm: float
    temperature_disturbance_c: float
    force_disturbance_kn: float
    speed_disturbance_rpm: float
    watchdog: WatchdogState
    refused_commands: int
    active_faults: tuple[str, ...]
    stopped: str


class PlantEmulator:
    """The emulated plant.

    Parameters
    ----------
    config : PlantConfig, optional
        The defaults of ``plant.yaml`` otherwise.
    schedule : PlantSchedule, optional
        Timed disturbances and faults.

    Attributes
    ----------
    tick : int
        The present tick.
    stopped : str
        Empty while the process runs. When the tool leaves the range of the model, the reason; the process then
        stands still and is measured as it stood, until :meth:`reset`.
    gate : CommandGate
        Counts the refused commands.
    watchdog : Watchdog
    disturbances : Disturbances
    faults : Faults

    Raises
    ------
    fsw_model.OperatingPointError
        If there is no equilibrium to start from within the limits of the drives.
    """

    def __init__(self, config: PlantConfig | None = None, schedule: PlantSchedule | None = None) -> None:
        self.config = config or PlantConfig.from_values({})
        self.schedule = schedule or PlantSchedule()
        self.tick = FIRST_TICK
        self.disturbances = Disturbances()
        self.faults = Faults()
        self._model = _process_model(self.config.model)
        self._reading: Reading | None = None
        self._start(self._equilibrium(self.config.start_depth_mm, self.config.start_temperature_c))

    def _equilibrium(self, depth_mm: float, temperature_c: float) -> Equilibrium:
        limits = self.config.limits
        start = self._model.equilibrium(depth_mm, temperature_c)
        force_fits = limits.force_min_kn <= start.force_kn <= limits.force_max_kn
        if not force_fits or not limits.speed_min_rpm <= start.speed_rpm <= limits.speed_max_rpm:
            raise OperatingPointError(
                f"start: {depth_mm:g} mm, {temperature_c:g} degC needs {start.force_kn:.2f} kN and "
                f"{start.speed_rpm:.1f} rpm, beyond the drives' limits"
            )
        return start

    def _start(self, start: Equilibrium) -> None:
        config = self.config
        self._state: ProcessState = start.state.copy()
        self._outputs: Outputs = start.outputs
        limits = config.limits
        self._force = Actuator(start.force_kn, limits.force_rate_kn_per_s, config.lag_s, STEP_S)
        self._speed = Actuator(start.speed_rpm, limits.speed_rate_rpm_per_s, config.lag_s, STEP_S)
        self._wanted = Command(start.force_kn, start.speed_rpm)
        self._force_kn, self._speed_rpm = start.force_kn, start.speed_rpm
        self._force_disturbance_kn = self._speed_disturbance_rpm = 0.0
        self._inertia_torque_nm = 0.0
        self._last_sent: list[float | None] = [None] * len(SENSORS)
        self.stopped = ""
        self.gate = CommandGate(limits, config.max_age_s, config.sources)
        self.watchdog = Watchdog(config.watchdog)
        self._sensors = [
            NoisySensor(config.seed, i, noise, resolution)
            for i, (noise, resolution) in enumerate(_sensor_settings(config))
        ]

    @property
    def time_s(self) -> float:
        """Time of the present tick."""
        return self.tick / 10

    @property
    def applied(self) -> Command:
        """The command that the drives follow (the watchdog's while it has taken over)."""
        return self._wanted

    def measure(self, stamp_ns: int | None = None) -> Reading:
        """What the sensors send at the present tick; asked again at the same tick, the same.

        Parameters
        ----------
        stamp_ns : int, optional
            Stamp of the tick; the tick's own time by default.
        """
        reading = self._reading
        if reading is not None and reading.tick == self.tick:
            return reading
        time_s = self.tick / 10
        if self.schedule.next_s <= time_s + 1e-9:
            self._apply_events(time_s)
        stamp = self.tick * TICK_NS if stamp_ns is None else stamp_ns
        outputs = self._outputs
        depth, temperature = outputs.depth_mm, outputs.temperature_c
        if self.disturbances:
            depth += self.disturbances.value("depth", time_s)
            temperature += self.disturbances.value("temperature", time_s)
        drop_nm = self.config.sensors.torque_drop_nm_per_rpm * (self._speed_rpm - weld.SPEED_RPM)
        torque = outputs.motor_torque_nm + self._inertia_torque_nm - drop_nm
        a, b, c = self._sensors
        samples = [Sample(stamp, a.read(depth)), Sample(stamp, b.read(torque)), Sample(stamp, c.read(temperature))]
        if self.faults:
            sent: list[tuple[Sample, ...]] = [
                self.faults.pass_on(sensor, sample, time_s, last)
                for sensor, sample, last in zip(SENSORS, samples, self._last_sent, strict=True)
            ]
        else:
            sent = [(sample,) for sample in samples]
        reading = Reading(self.tick, stamp, sent[0], sent[1], sent[2], Command(self._force_kn, self._speed_rpm))
        self._last_sent = [sample.value for sample in samples]
        self._reading = reading
        return reading

    def _apply_events(self, time_s: float) -> None:
        for event in self.schedule.due(time_s):
            if event.is_fault:
                self.faults.set(event.target, event.fault())
            else:
                self.disturbances.set(event.target, event.disturbance())

    def apply(self, command: Command, stamp_ns: int | None = None, source: str = "", healthy: bool = True) -> str:
        """Obey a command from the present tick on, or refuse it.

        Parameters
        ----------
        command : Command
            The command.
        stamp_ns : int, optional
            Stamp of the measurement that it answers; the last one by default.
        source : str
            Who computed it.
        healthy : bool
            Whether its sender says that it may be applied.

        Returns
        -------
        str
            Empty when obeyed, else why not (one of ``commands.REASONS``); ``gate`` counts and keeps the words.
        """
        measured_ns = None if self._reading is None else self._reading.stamp_ns
        if stamp_ns is None:
            stamp_ns = measured_ns or 0
        checked = self.gate.check(command, stamp_ns, source, healthy, measured_ns)
        if isinstance(checked, str):
            return checked
        self._wanted = checked
        self.watchdog.feed()
        return ""

    def step(self) -> None:
        """Advance to the next tick; never raises."""
        time_s = self.tick / 10
        force = self.watchdog.advance(self._wanted.force_kn, STEP_S)
        if force != self._wanted.force_kn:
            self._wanted = Command(force, self._wanted.speed_rpm)
        mean_force = self._force.advance(force)
        mean_speed = self._speed.advance(self._wanted.speed_rpm)
        end_force, end_speed = self._force.position, self._speed.position
        by_force = by_speed = 0.0
        if self.disturbances:
            by_force = self.disturbances.value("axial_force", time_s)
            by_speed = self.disturbances.value("spindle_speed", time_s)
        if not self.stopped:
            self._advance_process(
                mean_force + by_force, mean_speed + by_speed, end_force + by_force, end_speed + by_speed
            )
            self._force_disturbance_kn, self._speed_disturbance_rpm = by_force, by_speed
        self.tick += 1

    def _advance_process(self, mean_force: float, mean_speed: float, end_force: float, end_speed: float) -> None:
        try:
            self._model.step(self._state, mean_force, mean_speed)
            outputs = self._model.outputs(self._state, end_force, end_speed)
        except OperatingPointError as error:
            self.stopped = f"process stopped at {self.time_s:.1f} s: {error}"
            return
        acceleration = (end_speed - self._speed_rpm) / STEP_S
        self._inertia_torque_nm = self.config.model.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * acceleration
        self._outputs = outputs
        self._force_kn, self._speed_rpm = end_force, end_speed

    def truth(self) -> Truth:
        """The plant as it is at the present tick, in the inputs of the step that ended there."""
        outputs, time_s, disturbances = self._outputs, self.tick / 10, self.disturbances
        depth_disturbance = disturbances.value("depth", time_s)
        temperature_disturbance = disturbances.value("temperature", time_s)
        return Truth(
            tick=self.tick,
            stamp_ns=self.tick * TICK_NS if self._reading is None else self._reading.stamp_ns,
            depth_mm=outputs.depth_mm + depth_disturbance,
            temperature_c=outputs.temperature_c + temperature_disturbance,
            copper_temperature_c=outputs.copper_temperature_c,
            motor_torque_nm=outputs.motor_torque_nm,
            process_torque_nm=outputs.process_torque_nm,
            friction_torque_nm=outputs.friction_torque_nm,
            process_power_kw=outputs.power_kw,
            force_kn=self._force_kn,
            speed_rpm=self._speed_rpm,
            depth_disturbance_mm=depth_disturbance,
            temperature_disturbance_c=temperature_disturbance,
            force_disturbance_kn=self._force_disturbance_kn,
            speed_disturbance_rpm=self._speed_disturbance_rpm,
            watchdog=self.watchdog.state,
            refused_commands=self.gate.total(),
            active_faults=tuple(self.faults.names()),
            stopped=self.stopped,
        )

    def set_disturbance(
        self, channel: str, shape: str, amplitude: float, duration_s: float = 0.0, period_s: float = 0.0
    ) -> None:
        """Put a disturbance on a channel; ``none`` clears it.

        On an output it begins with the next tick measured, on an input with the next step.

        Parameters
        ----------
        channel, shape : str
            One of ``disturbances.CHANNELS`` and ``disturbances.SHAPES``.
        amplitude : float
            In mm, degC, kN, rpm.
        duration_s, period_s : float
            See `Disturbance`.

        Raises
        ------
        DisturbanceError
            If there is no such channel or shape, or a number makes no sense.
        """
        start_s = self._next_s() if channel in OUTPUT_CHANNELS else self.time_s
        self.disturbances.set(channel, Disturbance(shape, amplitude, duration_s, period_s, start_s))

    def set_fault(self, sensor: str, kind: str, magnitude: float = 0.0, duration_s: float = 0.0) -> None:
        """Give a sensor a fault, beginning with the next tick measured; ``none`` clears it.

        Parameters
        ----------
        sensor, kind : str
            One of ``fsw_control.SENSORS`` and ``faults.KINDS``.
        magnitude, duration_s : float
            See `Fault`.

        Raises
        ------
        DisturbanceError
            If there is no such sensor or kind, or a number makes no sense.
        """
        self.faults.set(sensor, Fault(kind, magnitude, duration_s, self._next_s()))

    def _next_s(self) -> float:
        measured = self._reading is not None and self._reading.tick == self.tick
        return (self.tick + 1 if measured else self.tick) / 10

    def reset(self, seed: int | None = None, depth_mm: float | None = None, temperature_c: float | None = None) -> None:
        """Start again from an equilibrium; disturbances, faults and counters are cleared, time and schedule go on.

        Parameters
        ----------
        seed : int, optional
            Of the noise; the configured one by default.
        depth_mm, temperature_c : float, optional
            The equilibrium; the configured one by default.

        Raises
        ------
        fsw_model.OperatingPointError
            If there is no such equilibrium; the plant then goes on as it was.
        """
        start = self._equilibrium(
            self.config.start_depth_mm if depth_mm is None else depth_mm,
            self.config.start_temperature_c if temperature_c is None else temperature_c,
        )
        if seed is not None:
            self.config = replace(self.config, seed=seed)
        self.disturbances.clear()
        self.faults.clear()
        answered_ns = self.gate.last_stamp_ns
        self._start(start)
        self.gate.last_stamp_ns = answered_ns

    def reconfigure(self, config: PlantConfig) -> None:
        """Change settings while running; start and seed hold from the next :meth:`reset`.

        Raises
        ------
        fsw_model.ParameterError
            If the model does not take its parameters; nothing is changed then.
        """
        if config.model != self.config.model:
            model = _process_model(config.model)
            self._state.power = model.with_history(self._state.power)
            self._model = model
        self.config = config
        limits = config.limits
        self._force.configure(limits.force_rate_kn_per_s, config.lag_s, STEP_S)
        self._speed.configure(limits.speed_rate_rpm_per_s, config.lag_s, STEP_S)
        self.gate.configure(limits, config.max_age_s, config.sources)
        self.watchdog.config = config.watchdog
        for sensor, (noise, resolution) in zip(self._sensors, _sensor_settings(config), strict=True):
            sensor.noise, sensor.resolution = noise, resolution


@lru_cache(maxsize=16)
def _process_model(parameters: ModelParameters) -> ProcessModel:
    """The model of these parameters; it has no state, and takes a tenth of a second to make."""
    return ProcessModel(parameters)


def _sensor_settings(config: PlantConfig) -> tuple[tuple[float, float], ...]:
    """Noise and resolution of each sensor, in the order of ``SENSORS``."""
    if not config.noise:
        return ((0.0, 0.0),) * len(SENSORS)
    s = config.sensors
    return (
        (s.depth_noise_mm, s.depth_resolution_mm),
        (s.torque_noise_nm, s.torque_resolution_nm),
        (s.temperature_noise_c, s.temperature_resolution_c),
    )
