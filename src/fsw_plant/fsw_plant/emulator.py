"""The plant emulator: process, drives, sensors, disturbances, faults and watchdog, by ticks.

Use, per tick (see also :class:`Reading`)::

    plant = PlantEmulator(PlantConfig.from_values({"seed": 1, "start": {"depth_mm": 2.7}}),
                          PlantSchedule.from_yaml(scenario))
    while True:
        reading = plant.measure()           # state before this tick's command acts
        refusal = plant.apply(command)      # "" if accepted; effective until the next tick
        plant.step()                        # 0.1 s on

Tick k has the time ``k * 0.1 s``. The first tick is 1, because a stamp of zero means "no time" in
ROS. A scheduled event takes effect at the first tick that is not earlier: output disturbances and
faults on the samples of that tick, input disturbances on the step that begins there.

Units: mm, degC, N m, kN, rpm, s; stamps in ns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import IntEnum
from typing import Any, NamedTuple

from fsw_control import Command, Limits, weld
from fsw_control.command_gate import CommandGate, refusal
from fsw_control.depth_fusion import DepthEstimate
from fsw_model import STEP_S, Equilibrium, OperatingPointError
from fsw_model.fused_depth import FusedDepth
from fsw_plant.config import PlantConfig
from fsw_plant.core import PlantCore
from fsw_plant.events import OUTPUT_CHANNELS, Disturbance, Fault, PlantEvent, Sample
from fsw_plant.library import CHANNELS
from fsw_plant.parameters import Machine
from fsw_plant.schedule import PlantSchedule
from fsw_plant.tool_path import ToolTravel

FIRST_TICK = 1
#: upper bound of the watchdog's duration: its times are limited (parameters.py)
_REST_TICKS = 36_000
#: longer steps mean that the plant was suspended, and its process with it [s]
_LONGEST_STEP_S = 1.0


class WatchdogState(IntEnum):
    """States, with the numbers of ``PlantState.WATCHDOG_*``."""

    OK = 0
    HOLD = 1
    SAFE = 2


class Watchdog:
    """Measures the time since the last valid command.

    OK until ``timeout_s`` without a valid command; then HOLD: the last command stays; after
    another ``hold_s`` SAFE: the force decreases to ``safe_force_kn`` at ``safe_rate_kn_per_s`` (a
    lower force stays) and the spindle keeps its speed. A valid command ends both at once. Before
    the first valid command it holds without going to SAFE, unless ``armed_at_start``. The
    settings are those of ``parameters.py``.
    """

    def __init__(self, config: PlantConfig) -> None:
        self.config = config
        self.begin()

    def begin(self) -> None:
        """Wait for the first command."""
        self.state = WatchdogState.OK
        self.age_s = 0.0
        self.armed: bool = self.config["watchdog.armed_at_start"]

    def feed(self) -> None:
        """Note a valid command."""
        self.age_s = 0.0
        self.armed = True
        self.state = WatchdogState.OK

    def expire(self) -> None:
        """Ramp to the safe state now, as the incoming commands ignore a safe stop in force."""
        self.armed = True
        self.age_s = max(
            self.age_s, self.config["watchdog.timeout_s"] + self.config["watchdog.hold_s"]
        )

    def advance(self, force_kn: float, elapsed_s: float = STEP_S) -> float:
        """Decide for the step that begins now, and count it: returns the force to apply.

        ``elapsed_s`` is the steady time since the previous step, for steps that are late.
        """
        step_s = min(max(elapsed_s, STEP_S), _LONGEST_STEP_S)
        self.age_s += step_s - STEP_S
        config = self.config.values
        age, timeout_s = self.age_s + 1e-9, config["watchdog.timeout_s"]
        if age >= timeout_s:
            safe = self.armed and age >= timeout_s + config["watchdog.hold_s"]
            self.state = WatchdogState.SAFE if safe else WatchdogState.HOLD
            safe_force_kn = config["watchdog.safe_force_kn"]
            if safe and force_kn > safe_force_kn:
                force_kn = max(
                    safe_force_kn, force_kn - config["watchdog.safe_rate_kn_per_s"] * step_s
                )
        self.age_s += STEP_S
        return force_kn


class BeyondDrivesError(OperatingPointError):
    """A start needs a force or a speed that the drives cannot give: ``required``."""

    def __init__(self, words: str, required: Command) -> None:
        super().__init__(
            f"start: {words} needs {required.force_kn:.2f} kN and {required.speed_rpm:.1f} rpm, "
            "beyond the drives' limits"
        )
        self.required = required


class Reading(NamedTuple):
    """The samples sent by the sensors at a tick."""

    tick: int
    stamp_ns: int  #: of the tick
    #: by sensor: one sample while it works, none on dropout, two on duplication, one with an older
    #: stamp if it is late
    samples: Mapping[str, tuple[Sample, ...]]
    #: acting inputs as the drives report them: including input disturbances, as a load cell sees
    #: them
    drives: Command
    fused: DepthEstimate | None = None  #: estimate behind a fused depth
    footprint_bias_mm: float = 0.0  #: taken off the depth, by the footprint of an earlier weld

    @property
    def values(self) -> dict[str, float]:
        """Samples of this tick by sensor, the last one if there are several."""
        return {
            name: sample.value
            for name, samples in self.samples.items()
            for sample in samples
            if sample.stamp_ns == self.stamp_ns
        }


class Truth(NamedTuple):
    """The plant's true state, without noise and faults; for analysis only."""

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


class PlantEmulator:
    """The emulated plant.

    Parameters
    ----------
    config : PlantConfig, optional
        By default those of the parameters.
    schedule : PlantSchedule, optional
        Timed disturbances and faults.

    Raises
    ------
    fsw_model.OperatingPointError
        If no equilibrium within the drives' limits exists for the start, or, on a canister, it
        cannot be heated.
    """

    def __init__(
        self, config: PlantConfig | None = None, schedule: PlantSchedule | None = None
    ) -> None:
        self.config = config or PlantConfig.from_values({})
        self.schedule = schedule or PlantSchedule()
        self.tick = FIRST_TICK  #: the present tick
        #: drives, process and sensors; ``core.memory`` is their state, in C
        self.core = PlantCore(self.config)
        self.travel = ToolTravel(self.schedule.path, self.config)
        self._reading: Reading | None = None
        self._start()

    def _equilibrium(self, depth: float, temperature: float) -> Equilibrium:
        motion = self.travel.motion(self.tick)
        start = self.core.equilibrium(self.config, depth, temperature, motion)
        _check_within(self.config.limits, start, f"{depth:g} mm, {temperature:g} degC")
        return start

    def _start(
        self,
        depth_mm: float | None = None,
        temperature_c: float | None = None,
        seed: int | None = None,
    ) -> None:
        """See :meth:`reset`."""
        config = self.config
        depth = config["start.depth_mm"] if depth_mm is None else depth_mm
        temperature = config["start.temperature_c"] if temperature_c is None else temperature_c
        start = self._equilibrium(depth, temperature)
        if seed is not None:
            self.config = replace(self.config, values={**self.config.values, "seed": seed})
        config, limits = self.config, self.config.limits
        self.core.start(config, depth, temperature, start)
        #: the command that the drives follow (the watchdog's after it has taken over)
        self.applied = self._acting = self.core.acting
        self._input_disturbance = Command(0.0, 0.0)
        #: empty while the process runs. If the tool leaves the model's range of validity, the
        #: reason; the process then stands still and is measured as it is, until :meth:`reset`
        self.stopped = ""
        self.disturbances: dict[str, Disturbance] = {}  #: active ones, by slot
        self.faults: dict[str, Fault] = {}  #: active ones, by sensor
        self.gate = CommandGate(limits, config["commands.max_age_s"], config["commands.sources"])
        self.watchdog = Watchdog(config)
        self._last: dict[str, float] = {}
        self._fusion = None
        if config.machine.depth_channels:
            self._fusion = FusedDepth(config.footprint, config.machine.touch_off_kn)

    def take(self, schedule: PlantSchedule) -> None:
        """Use another schedule."""
        self.schedule = schedule
        self.travel.take(schedule.path)

    @property
    def time_s(self) -> float:
        """Time of the present tick."""
        return self.tick / 10

    @property
    def follows_programme(self) -> bool:
        """Whether it matters where on its path the tool is."""
        config = self.config
        return config.canister is not None or (
            bool(self.schedule.path) and config.machine != Machine()
        )

    def follow_programme(self, time_s: float, standing: bool, age_ticks: int = 0) -> None:
        """Take the programme's time some ticks ago, and whether it is held; the tool follows.

        Without programme reports the tool follows the clock. Future events shift with it.
        """
        self.travel.follow(self.tick, time_s, standing, age_ticks)

    def measure(self, stamp_ns: int | None = None) -> Reading:
        """The samples sent at the present tick; repeatable. ``stamp_ns`` replaces its stamp."""
        if self._reading is not None and self._reading.tick == self.tick:
            return self._reading
        # Scheduled events are in the programme's time, which stands while a weld is held; one
        # that begins has the plant's time, so that its own course follows the clock
        if self.schedule.events:
            lag_s = self.travel.lag_s
            for event in self.schedule.due(self.travel.programme_s(self.tick)):
                self._begin(replace(event, at_s=event.at_s + lag_s) if lag_s else event)
        stamp = self.tick * weld.TICK_NS if stamp_ns is None else stamp_ns
        if self.faults:
            self.faults = {
                name: fault for name, fault in self.faults.items() if not fault.over(self.time_s)
            }
        self._disturb()
        # from the process outwards, as on a machine: sensors with noise, the footprint's bias,
        # faults on the way, and the fusion of what has arrived, whose result can be faulty as well
        shown = dict(zip(self.core.sensors, self.core.measure(), strict=True))
        angle_deg = self.core.angle_deg
        bias_mm = 0.0
        if self.config.footprint is not None and self._fusion is None:
            bias_mm, _ = self.config.footprint.bias_mm("depth", angle_deg)
            shown["depth"] -= bias_mm
        fused = None
        samples = {
            name: self._sent(name, value, stamp)
            for name, value in shown.items()
            if name != "depth" or self._fusion is None
        }
        if self._fusion is not None:
            values = Reading(self.tick, stamp, samples, self._acting).values
            fused = self._fusion.update(
                stamp * 1e-9, values, self._acting, angle_deg, self.core.travel_mm
            )
            bias_mm = fused.footprint_mm
            samples = {"depth": self._sent("depth", fused.depth_mm, stamp), **samples}
        self._reading = Reading(self.tick, stamp, samples, self._acting, fused, bias_mm)
        return self._reading

    def _sent(self, name: str, value: float, stamp_ns: int) -> tuple[Sample, ...]:
        """Samples that leave a sensor, with its fault."""
        last, self._last[name] = self._last.get(name), value
        fault, sample = self.faults.get(name), Sample(stamp_ns, value)
        return (sample,) if fault is None else fault.pass_on(sample, self.time_s, last)

    def _disturb(self) -> None:
        """Set all disturbances to their values at the present tick."""
        for channel, value in self._disturbed().items():
            setattr(self.core.added, CHANNELS[channel], value)

    def _disturbed(self) -> dict[str, float]:
        """Disturbances at the present tick by channel, without those where none is active."""
        values: dict[str, float] = {}
        for active in self.disturbances.values():  # two on a channel that has a random one, too
            values[active.target] = values.get(active.target, 0.0) + active.value(self.time_s)
        return values

    def _begin(self, event: PlantEvent) -> None:
        active: dict[str, Any] = self.faults if isinstance(event, Fault) else self.disturbances
        if event.kind == "none":
            for slot in [slot for slot, value in active.items() if value.target == event.target]:
                del active[slot]
            if active is self.disturbances:
                setattr(self.core.added, CHANNELS[event.target], 0.0)
        else:
            if isinstance(event, Disturbance):
                # by channel, so that two random disturbances of a weld are independent
                event.begin((self.config["seed"], list(CHANNELS).index(event.target)))
            active[event.slot] = event

    def apply(
        self, command: Command, stamp_ns: int | None = None, source: str = "", healthy: bool = True
    ) -> str:
        """Accept a command for the present tick on, or reject it.

        Parameters
        ----------
        command : Command
        stamp_ns : int, optional
            Stamp of the measurement that it answers; by default the last one.
        source : str
            Its origin.
        healthy : bool
            Whether its sender marked it as applicable.

        Returns
        -------
        str
            Empty if accepted, else the reason (one of ``command_gate.REASONS``); ``gate`` counts
            it and keeps its figures.
        """
        measured_ns = None if self._reading is None else self._reading.stamp_ns
        if stamp_ns is None:
            stamp_ns = measured_ns or 0
        reason = self.gate.check(command, stamp_ns, source, healthy, measured_ns)
        if not reason:
            self.applied = self.config.limits.clip(command, None)
            self.watchdog.feed()
        return reason

    def step(self, elapsed_s: float = STEP_S) -> None:
        """Advance by a tick; never raises. The watchdog uses ``elapsed_s`` since the last step."""
        # The command for this tick has come or not: the watchdog decides what acts from here to
        # the next tick. Of the disturbances, those on inputs act over this step, those on outputs
        # at the measurement that follows
        force_kn = self.watchdog.advance(self.applied.force_kn, elapsed_s)
        if force_kn != self.applied.force_kn:
            self.applied = Command(force_kn, self.applied.speed_rpm)
        self._disturb()
        if not self.stopped:
            added = self.core.added
            self._input_disturbance = Command(added.force_kn, added.speed_rpm)
        motion = self.travel.motion(self.tick)
        words = self.core.advance(self.applied, motion)
        if words and not self.stopped:
            self.stopped = f"process stopped at {self.time_s:.1f} s: {words}"
        self._acting = self.core.acting
        self.travel.end_tick()
        self.tick += 1

    def truth(self) -> Truth:
        """True state at the present tick, with the inputs of the step that ended there."""
        outputs, disturbed = self.core.outputs, self._disturbed()
        depth_disturbance = disturbed.get("depth", 0.0)
        temperature_disturbance = disturbed.get("temperature", 0.0)
        return Truth(  # by position, which is twice as fast
            self.tick * weld.TICK_NS if self._reading is None else self._reading.stamp_ns,
            outputs.depth_mm + depth_disturbance,
            outputs.temperature_c + temperature_disturbance,
            outputs.copper_temperature_c,
            outputs.motor_torque_nm,
            outputs.process_torque_nm + disturbed.get("torque", 0.0),
            outputs.friction_torque_nm,
            outputs.power_kw,
            self._acting.force_kn,
            self._acting.speed_rpm,
            depth_disturbance,
            temperature_disturbance,
            self._input_disturbance.force_kn,
            self._input_disturbance.speed_rpm,
            self.watchdog.state,
            self.gate.total(),
            tuple(map(str, self.faults.values())),
        )

    def begin(self, event: PlantEvent) -> None:
        """Start a disturbance or a fault now, or end it with ``none``.

        On an input it takes effect with the next step, else with the next measured tick.
        """
        on_input = isinstance(event, Disturbance) and event.target not in OUTPUT_CHANNELS
        self._begin(replace(event, at_s=self.time_s if on_input else self._next_s()))

    def _next_s(self) -> float:
        measured = self._reading is not None and self._reading.tick == self.tick
        return (self.tick + 1 if measured else self.tick) / 10

    def reset(
        self,
        seed: int | None = None,
        depth_mm: float | None = None,
        temperature_c: float | None = None,
    ) -> None:
        """Restart from an equilibrium; clears events and counters, not time or schedule.

        It is a touch-off: all channels of the depth have their calibration's zero, and are used.
        Omitted values stay as configured.

        Raises
        ------
        fsw_model.OperatingPointError
            If there is no such equilibrium; the plant then continues unchanged.
        """
        answered_ns = self.gate.last_stamp_ns
        self._start(depth_mm, temperature_c, seed)
        self.gate.last_stamp_ns = answered_ns

    def reconfigure(self, config: PlantConfig) -> None:
        """Change settings while running; start and seed take effect at the next :meth:`reset`."""
        self.core.reconfigure(config, config.model != self.config.model)
        self.config = self.watchdog.config = config
        self.gate.configure(
            config.limits, config["commands.max_age_s"], config["commands.sources"]
        )


def come_to_rest(plant: PlantEmulator) -> None:
    """Let time pass until the watchdog has brought the drives into the safe state.

    It then waits for a first command again, as at the start.
    """
    # armed, it ramps also if no command has come yet; it is at rest once a step in SAFE no longer
    # changes the force
    plant.watchdog.armed = True
    for _ in range(_REST_TICKS):
        before_kn = plant.applied.force_kn
        plant.step()
        if plant.watchdog.state is WatchdogState.SAFE and plant.applied.force_kn == before_kn:
            break
    plant.watchdog.begin()


def _check_within(limits: Limits, start: Equilibrium, words: str) -> None:
    """Refuse a start that the drives cannot give."""
    required = Command(start.force_kn, start.speed_rpm)
    if refusal(required, limits) is not None:
        raise BeyondDrivesError(words, required)
