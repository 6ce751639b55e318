"""All tuning of the NMPC as data: presets, knobs and files; with model and limits its settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import exp
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from fsw_control import Limits, weld
from fsw_control.parameters import defaults
from fsw_control.schema.models import Many, Model, Whole, content_of, problem, read_text, validate
from fsw_control.sensors import SENSORS
from fsw_control.weld import TICK_S
from fsw_model import STEP_S, MachineData, ModelParameters, nominal
from fsw_nmpc.parameters import NmpcParameters

#: Kinds of reference trajectories, see ``kernel/trajectory.c``.
Trajectory = Literal["approach", "constant", "cold_start", "recentred", "recentred_ahead"]
#: The set-point that an approach keeps if the inputs' bounds exclude both.
Priority = Literal["depth", "balance", "temperature"]
TRAJECTORIES, PRIORITIES = get_args(Trajectory), get_args(Priority)
#: A number from 0 to 1.
Share = Annotated[float, Field(ge=0.0, le=1.0)]
#: Time constant of the temperature's approach in the default preset, as a share of the dead time.
#: The loop's margins scale with it.
_APPROACH_PER_DEAD_TIME = 0.3


def _keep(memory_s: float) -> float:
    """Decay factor per tick for an exponential memory of ``memory_s``."""
    return exp(-STEP_S / memory_s) if memory_s > 0.0 else 0.0


class EstimatorTuning(Model):
    """Standard deviations of the sensors and, per tick, of the disturbances' random walks."""

    depth_noise_mm: NonNegativeFloat = SENSORS["depth"].noise
    torque_noise_nm: NonNegativeFloat = SENSORS["torque"].noise
    temperature_noise_c: NonNegativeFloat = SENSORS["thermocouple"].noise
    creep_walk_mm: NonNegativeFloat = 1e-5
    copper_walk_c: NonNegativeFloat = 1e-3
    motor_walk_nm: NonNegativeFloat = 0.05
    force_walk_kn: NonNegativeFloat = 1.2e-3
    heat_walk_kw: NonNegativeFloat = 5e-4
    torque_scale_walk: NonNegativeFloat = 5e-5
    depth_offset_walk_mm: NonNegativeFloat = 2e-5
    temperature_offset_walk_c: NonNegativeFloat = 3e-2
    offset_memory_s: NonNegativeFloat = 600.0
    """time constant with which the two sensor offsets decay"""
    depth_rate_walk_mm_per_s: NonNegativeFloat = 5e-6
    """of the rate of the depth offset; 0: constant"""
    temperature_rate_walk_c_per_s: NonNegativeFloat = 2e-4
    """of the rate of the temperature offset; 0: constant"""
    depth_rate_memory_s: NonNegativeFloat = 30.0
    """time constant with which the rate of the depth offset decays"""
    temperature_rate_memory_s: NonNegativeFloat = 30.0
    """time constant with which the rate of the temperature offset decays"""
    depth_gain_walk: NonNegativeFloat = 1e-4
    """of the factor on the model's gain from force to depth; 0: it stays 1"""
    jump_sigmas: NonNegativeFloat = 4.0
    """an innovation of more standard deviations is a jump; 0: never"""
    drift_sigmas: NonNegativeFloat = 3.5
    """depth innovations are a drift if their sum over about a second exceeds this; 0: never"""

    start_deviation: Annotated[Many[NonNegativeFloat], Field(min_length=13, max_length=13)] = (
        5e-3,
        1e-3,
        0.5,
        0.2,
        2.0,
        0.2,
        0.15,
        5e-3,
        1e-3,
        0.15,
        1e-4,
        1e-2,
        0.2,
    )
    """standard deviations at the start, in the order of `fsw_state`: creep, slow, copper, tool,
    motor, force, heat, torque scale, offsets, their rates, depth gain"""
    torque_scale_min: NonNegativeFloat = 0.4
    """lower bound of the factor on the process torque"""
    torque_scale_max: NonNegativeFloat = 2.5
    """upper bound of the factor on the process torque"""
    depth_gain_min: NonNegativeFloat = 0.6
    """lower bound of the factor on the depth gain"""
    depth_gain_max: NonNegativeFloat = 1.6
    """upper bound of the factor on the depth gain"""
    depth_max_mm: NonNegativeFloat = 20.0
    """depths above this are implausible"""
    temperature_deviation_max_c: NonNegativeFloat = 800.0
    """larger deviations from the operating temperature are implausible"""
    force_offset_max_kn: NonNegativeFloat = 50.0
    """larger disturbance forces are implausible"""
    torque_outlier_factor: Annotated[float, Field(ge=1.0)] = 3.0
    """torque samples beyond this factor from the expectation are rejected"""
    torque_min_nm: PositiveFloat = 100.0
    """lower bound of the torque that scales a jump of the torque factor"""
    torque_peak_noise_share: Share = 0.3
    """share of the inertia peak that counts as noise: the drive's lag spreads it over two ticks"""
    jump_offset_share: Share = 0.5
    """share of a depth jump's variance given to the sensor offset; the true depth gets the rest"""
    drift_keep: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.9
    """decay per tick of the sum of depth innovations: a memory of about a second"""
    excitation_force_kn: NonNegativeFloat = 0.3
    """the depth gain is estimated while the force has moved by more within two seconds"""

    known_heat_keep: Share = 0.9983
    """share of the evidence for the known heat left after a tick: it covers about a minute"""
    known_heat_evidence: PositiveFloat = 20.0
    """logarithm of the likelihood ratio against the known heat at which none of it is used; as
    much counts for it at most"""
    known_heat_counter_evidence: NonNegativeFloat = 40.0
    """no more is counted against the known heat, so that it can be used again"""
    known_heat_walk_kw: NonNegativeFloat = 0.02
    """largest random walk of what the known heat lacks, however uncertain: more would cost the
    loop its margin"""
    known_heat_start_kw: NonNegativeFloat = 3.0
    """standard deviation of the heat at the start of a weld whose heat is known: there the process
    warms, and is not at rest"""
    known_heat_step: NonNegativeFloat = 0.05
    """largest change per tick of the share of the known heat in use"""

    @property
    def offset_keep(self) -> Share:
        """Decay per tick of the two sensor offsets."""
        return _keep(self.offset_memory_s)

    @property
    def depth_rate_keep(self) -> Share:
        """Decay per tick of the rate of the depth offset."""
        return _keep(self.depth_rate_memory_s)

    @property
    def temperature_rate_keep(self) -> Share:
        """Decay per tick of the rate of the temperature offset."""
        return _keep(self.temperature_rate_memory_s)


#: random walks of the estimator, which ``calmness`` divides
WALKS = tuple(name for name in EstimatorTuning.model_fields if "_walk" in name)
#: costs of moves, which ``calmness`` multiplies
MOVE_COSTS = ("move_force_per_kn", "move_speed_per_rpm", "full_move_cost")


class ApproachTuning(Model):
    """The approach to a set-point, see ``kernel/trajectory.c``."""

    force_time_s: PositiveFloat = 0.4
    """second, faster time constant of the depth: the force needs some ticks"""
    power_time_s: PositiveFloat = 0.3
    """second, faster time constant of the temperature: the power needs some ticks"""
    depth_acceleration: NonNegativeFloat = 1.55
    """acceleration of the depth relative to what the speed can compensate; more would disturb the
    temperature"""
    brake_share: Share = 0.8
    """usable share of the acceleration when braking"""
    rate_share: Share = 0.8
    """usable share of the temperature's maximum rate"""
    depth_approach_keep: Share = 0.8
    """share of the last tick's planned depth rate that is kept, to smooth noise"""
    temperature_approach_keep: Share = 0.93
    """share of the last tick's planned temperature rate that is kept, to smooth noise"""
    least_force_kn: NonNegativeFloat = 1.0
    """lower bound of the usable force, on either side of the holding force"""
    least_rate_c_per_s: NonNegativeFloat = 0.005
    """lower bound of the usable temperature rate"""
    least_power_kw: NonNegativeFloat = 1.0
    """lower bound of the holding power"""
    longest_lead_s: Annotated[float, Field(ge=0.0, le=60.0)] = 30.0
    """longest time by which an approach begins before a known future set-point"""
    beyond_bound_kw: NonNegativeFloat = 0.15
    """uncertainty of the estimated heat: a temperature beyond reach is sought with so much more
    power than a bound of the speed gives, so that noise does not move the speed from its bound"""


class Tuning(Model):
    """Reference trajectories, cost and estimator; the kernel uses the same names."""

    trajectory: Trajectory = "approach"
    """reference trajectory: approach, constant, cold_start, recentred or recentred_ahead"""
    depth_time_s: NonNegativeFloat = 1.0
    """time constant of the approach near the set-point, or of the corridor (tau_t, paper (32))"""
    temperature_time_s: NonNegativeFloat = 0.84
    """time constant of the approach near the set-point, or of the corridor (tau_t, paper (32))"""
    dead_band_depth_mm: NonNegativeFloat = 0.0
    """half width of the dead-band about the trajectory"""
    dead_band_temperature_c: NonNegativeFloat = 0.0
    """half width of the dead-band about the trajectory"""
    quality_depth_mm: NonNegativeFloat = weld.QUALITY_DEPTH_MM
    """largest depth error that an approach accepts in favour of the temperature"""
    quality_temperature_min_c: NonNegativeFloat = weld.QUALITY_TEMPERATURE_MIN_C
    """below it an approach lets the depth give way, whatever the priority"""
    quality_temperature_max_c: NonNegativeFloat = weld.QUALITY_TEMPERATURE_MAX_C
    """above it an approach lets the depth give way, whatever the priority"""
    weight_depth_per_mm: NonNegativeFloat = 0.0
    """L1 weight outside the dead-band, per output point"""
    weight_temperature_per_c: NonNegativeFloat = 0.0
    """L1 weight outside the dead-band, per output point"""
    depth_scale_mm: NonNegativeFloat = 0.0022
    """quadratic cost per output point: a deviation of this size costs 1/2; 0: none"""
    temperature_scale_c: NonNegativeFloat = 0.2
    """quadratic cost per output point: a deviation of this size costs 1/2; 0: none"""
    move_force_per_kn: NonNegativeFloat = 0.0
    """L1 weight on the moves of an interval"""
    move_speed_per_rpm: NonNegativeFloat = 0.0
    """L1 weight on the moves of an interval"""
    full_move_cost: NonNegativeFloat = 0.2
    """quadratic cost of an interval's move, twice that of the largest move, for both inputs"""
    blocks: Literal[20, 54] = 20
    """20: blocks of moves over the 54 intervals; 54: a move per interval, as in the paper"""
    second_solve_distance: NonNegativeFloat = 0.5
    """the problem is solved again about its solution if the first move is further from the
    expected one, in largest moves"""
    second_solve_iterations: Annotated[Whole, Field(ge=0, le=200)] = 12
    """most iterations of the first solve after which it is solved again: after more, the second
    solve could exceed the tick"""
    tolerance: NonNegativeFloat = 1e-6
    """of the solver: complementarity gap relative to 1 + |cost|"""
    approach: ApproachTuning = ApproachTuning()
    estimator: EstimatorTuning = EstimatorTuning()

    @model_validator(mode="after")
    def _check_approach(self) -> Tuning:
        for name in ("depth_time_s", "temperature_time_s"):
            if self.trajectory == "approach" and getattr(self, name) < 2 * STEP_S:
                raise problem(
                    f"is {getattr(self, name):g}: an approach takes at least {2 * STEP_S} s", name
                )
        if self.quality_temperature_min_c >= self.quality_temperature_max_c:
            raise problem("is not above quality_temperature_min_c", "quality_temperature_max_c")
        return self

    @classmethod
    def preset(cls, name: str, parameters: ModelParameters) -> Tuning:
        """A named tuning for a model.

        Parameters
        ----------
        name : str
            ``default``: by rule from the model; ``paper``: (28)-(37), with estimated disturbances;
            ``paper:letter``: without, as in the paper.
        parameters : ModelParameters

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        if name == "default":
            time_s = max(_APPROACH_PER_DEAD_TIME * parameters.dead_time_s, 2 * STEP_S)
            return cls().changed(temperature_time_s=time_s)
        presets = {"paper": PAPER, "paper:letter": PAPER_LETTER}
        if name not in presets:
            raise ValueError(f"preset {name!r} is unknown; known: default, {', '.join(presets)}")
        return presets[name]

    def with_noise(self, machine: MachineData) -> Tuning:
        """Take a machine's sensors to be as noisy as its data show.

        Not less noisy than the tuning has them: that also covers small errors of the model.
        """
        noise = {
            name: max(getattr(self.estimator, name), value)
            for name, value in machine
            if name in EstimatorTuning.model_fields and value is not None
        }
        return self.changed(estimator=self.estimator.changed(**noise)) if noise else self

    def with_knobs(
        self,
        depth_aggressiveness: float = 1.0,
        temperature_aggressiveness: float = 1.0,
        calmness: float = 1.0,
    ) -> Tuning:
        """Scale the tuning by knobs; 1 leaves it unchanged.

        Parameters
        ----------
        depth_aggressiveness, temperature_aggressiveness : float
            Divide the time constants of the trajectories.
        calmness : float
            Multiplies the cost of moves and divides the random walks of the estimator.
        """
        return self.changed(
            depth_time_s=self.depth_time_s / depth_aggressiveness,
            temperature_time_s=self.temperature_time_s / temperature_aggressiveness,
            **{name: getattr(self, name) * calmness for name in MOVE_COSTS},
            estimator=self.estimator.changed(
                **{name: getattr(self.estimator, name) / calmness for name in WALKS}
            ),
        )

    @property
    def depth_corridor_keep(self) -> Share:
        """Decay per tick of the depth corridor's distance to the set-point."""
        return _keep(self.depth_time_s)

    @property
    def temperature_corridor_keep(self) -> Share:
        """Decay per tick of the temperature corridor's distance to the set-point."""
        return _keep(self.temperature_time_s)

    @classmethod
    def from_file(cls, path: str | Path, base: Tuning) -> Tuning:
        """Read a YAML file of fields over ``base``; the estimator's are a mapping ``estimator``.

        Raises
        ------
        fsw_control.schema.models.InputError
            If the file cannot be read or its content is invalid; the message is one line.
        """
        content = content_of(read_text(path, "tuning_file"), str(path))
        return validate(cls, _over(base.model_dump(), content), str(path))


def _over(base: dict[str, Any], content: Any) -> Any:
    """Merge one nested mapping over another; any other value replaces the old one."""
    if not isinstance(content, Mapping):
        return content
    return base | {
        name: _over(base[name], value) if isinstance(base.get(name), dict) else value
        for name, value in content.items()
    }


#: (28)-(37): L1 cost outside dead-bands about first-order corridors (32), (33), with the weights
#: of (37) and constant offsets. Of the ways to start the corridors, which the text leaves open,
#: the one with which its statements about Figs. 6 to 9 hold (benchmarks/paper_statements.py).
PAPER = Tuning(
    trajectory="cold_start",
    depth_time_s=5.0,
    temperature_time_s=5.0,
    dead_band_depth_mm=2e-3,
    dead_band_temperature_c=0.1,
    weight_depth_per_mm=100.0,
    weight_temperature_per_c=1.0,
    depth_scale_mm=0.0,
    temperature_scale_c=0.0,
    move_force_per_kn=1.0,
    move_speed_per_rpm=0.01,
    full_move_cost=0.0,
    blocks=54,
    estimator=EstimatorTuning(
        depth_rate_walk_mm_per_s=0.0,
        temperature_rate_walk_c_per_s=0.0,
        depth_gain_walk=0.0,
        drift_sigmas=0.0,
    ),
)
#: To the letter: "no disturbance model". Only process states are estimated.
PAPER_LETTER = PAPER.changed(
    estimator=PAPER.estimator.changed(
        force_walk_kn=0.0,
        heat_walk_kw=0.0,
        torque_scale_walk=0.0,
        depth_offset_walk_mm=0.0,
        temperature_offset_walk_c=0.0,
        jump_sigmas=0.0,
    )
)


_DEFAULTS = defaults(NmpcParameters)


@dataclass(frozen=True, slots=True)
class Settings:
    """All settings of the node, validated."""

    model: ModelParameters
    tuning: Tuning
    limits: Limits
    priority: Priority = _DEFAULTS["priority"]
    max_iterations: int = _DEFAULTS["max_iterations"]
    plan_reuse: int = _DEFAULTS["plan_reuse"]
    blind_limit_s: float = _DEFAULTS["blind_limit"]
    preview: bool = _DEFAULTS["preview"]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from parameter values; missing ones have their defaults.

        Raises
        ------
        ValueError
            If a value is unknown or out of range, values contradict each other, or a file is not
            usable.
        """
        v = NmpcParameters.from_values(values).flat()
        model = ModelParameters.from_file(v["model_file"]) if v["model_file"] else nominal()
        machine = MachineData()
        if v["machine_file"]:
            machine = MachineData.from_file(v["machine_file"])
        tuning = Tuning.preset(v["preset"], model).with_noise(machine)
        if v["tuning_file"]:
            tuning = Tuning.from_file(v["tuning_file"], tuning)
        tuning = tuning.with_knobs(
            v["depth_aggressiveness"], v["temperature_aggressiveness"], v["calmness"]
        )
        return cls(
            model=model,
            tuning=tuning,
            limits=_reached(Limits.of(v), machine),
            priority=v["priority"],
            max_iterations=v["max_iterations"],
            plan_reuse=v["plan_reuse"],
            blind_limit_s=v["blind_limit"],
            preview=v["preview"],
        )


def _reached(limits: Limits, machine: MachineData) -> Limits:
    """Limits whose moves the drives can follow."""
    rates = {
        "force_step_kn": machine.force_rate_kn_per_s,
        "speed_step_rpm": machine.speed_rate_rpm_per_s,
    }
    slower = {
        name: min(getattr(limits, name), TICK_S * rate)
        for name, rate in rates.items()
        if rate is not None
    }
    return replace(limits, **slower)
