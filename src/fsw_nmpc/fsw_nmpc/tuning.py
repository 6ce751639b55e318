"""All tuning of the NMPC as data: the presets ``paper`` and ``default``, knobs, and files."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, NonNegativeFloat, model_validator

from fsw_control import Limits, weld
from fsw_control.parameters import defaults, load
from fsw_model import STEP_S, ModelParameters
from fsw_nmpc.library import KERNEL, Priority, State, Trajectory
from fsw_schema.models import Model, content_of, problem, read_text, validate

#: Reference trajectories, see ``kernel/trajectory.c``.
TRAJECTORIES = tuple(trajectory.name.lower() for trajectory in Trajectory)
#: What the approach keeps where the inputs' bounds do not permit both set-points.
PRIORITIES = tuple(priority.name.lower() for priority in Priority)
#: By preset: the temperature's approach takes this share of the dead time. Margins of the loop scale with it.
_APPROACH_PER_DEAD_TIME = {"default": 0.3, "adaptive": 0.36}
#: Where an output may give way: share by which the depth waits for what the speed can compensate, by priority.
_HELD_SHARE = {"depth": 0.0, "balance": 0.5, "temperature": 1.0}
#: defaults of the node's parameters
_NODE = defaults(load("fsw_nmpc", "nmpc.yaml"))


def _known(trajectory: str) -> str:
    if trajectory not in TRAJECTORIES:
        raise ValueError(f"is {trajectory!r}; one of {', '.join(TRAJECTORIES)}")
    return trajectory


class EstimatorTuning(Model):
    """Standard deviations of the sensors, and of the random walks per tick of the disturbances."""

    depth_noise_mm: NonNegativeFloat = 2e-3
    torque_noise_nm: NonNegativeFloat = 2.0
    temperature_noise_c: NonNegativeFloat = 0.1
    creep_walk_mm: NonNegativeFloat = 1e-5
    copper_walk_c: NonNegativeFloat = 1e-3
    motor_walk_nm: NonNegativeFloat = 0.05
    force_walk_kn: NonNegativeFloat = 1.2e-3
    heat_walk_kw: NonNegativeFloat = 5e-4
    torque_scale_walk: NonNegativeFloat = 5e-5
    depth_offset_walk_mm: NonNegativeFloat = 2e-5
    temperature_offset_walk_c: NonNegativeFloat = 3e-2
    offset_memory_s: NonNegativeFloat = 600.0
    """time constant with which the two offsets leak"""
    depth_rate_walk_mm_per_s: NonNegativeFloat = 5e-6
    """of the rate of the depth's offset; 0: it does not move"""
    temperature_rate_walk_c_per_s: NonNegativeFloat = 2e-4
    """of the rate of the temperature's offset; 0: it does not move"""
    depth_rate_memory_s: NonNegativeFloat = 30.0
    """time constant with which the rate of the depth's offset leaks"""
    temperature_rate_memory_s: NonNegativeFloat = 30.0
    """time constant with which the rate of the temperature's offset leaks"""
    depth_gain_walk: NonNegativeFloat = 1e-4
    """of the factor on the model's gain of the depth over the force; 0: it stays 1"""
    thermal_gain_walk: NonNegativeFloat = 0.0
    """of the factor on the model's effect of the power on the copper; 0: it stays 1"""
    delay_walk_s: NonNegativeFloat = 0.0
    """of the time by which the power arrives later than after the model's dead time; 0: it stays 0"""
    jump_sigmas: NonNegativeFloat = 4.0
    """a measurement further off is a jump; 0: never"""
    drift_sigmas: NonNegativeFloat = 3.5
    """innovations of the depth whose sum over about a second is further off are a drift; 0: never"""
    heat_sigmas: NonNegativeFloat = 0.0
    """innovations of the temperature whose sum over about ten seconds is further off are heat that the model lacks;
    0: never"""

    @model_validator(mode="after")
    def _check_heat(self) -> EstimatorTuning:
        if self.heat_sigmas > 0.0 and not self.thermal_gain_walk > 0.0:
            text = "needs a thermal_gain_walk above 0: with a wrong gain the speed would swing; else set it to 0"
            raise problem(text, "heat_sigmas")
        return self

    def walks(self) -> tuple[float, ...]:
        """The walks in the library's order of states; slow and tool do not walk by themselves."""
        walk = [0.0] * len(State)
        walk[0], walk[2], walk[4:] = (
            self.creep_walk_mm,
            self.copper_walk_c,
            (
                self.motor_walk_nm,
                self.force_walk_kn,
                self.heat_walk_kw,
                self.torque_scale_walk,
                self.depth_offset_walk_mm,
                self.temperature_offset_walk_c,
                self.depth_rate_walk_mm_per_s,
                self.temperature_rate_walk_c_per_s,
                self.depth_gain_walk,
                self.thermal_gain_walk,
                self.delay_walk_s,
            ),
        )
        return tuple(walk)


class Tuning(Model):
    """Reference trajectories, cost and estimator."""

    trajectory: Annotated[str, AfterValidator(_known)] = "approach"
    """reference trajectory: approach, constant, cold_start, recentred or recentred_ahead"""
    depth_time_s: NonNegativeFloat = 1.0
    """time constant of the approach near the set-point, or of the corridor (tau_t)"""
    temperature_time_s: NonNegativeFloat = 0.84
    """time constant of the approach near the set-point, or of the corridor (tau_t)"""
    dead_band_depth_mm: NonNegativeFloat = 0.0
    """half width of the dead-band about the trajectory"""
    dead_band_temperature_c: NonNegativeFloat = 0.0
    """half width of the dead-band about the trajectory"""
    quality_depth_mm: NonNegativeFloat = weld.QUALITY_DEPTH_MM
    """an approach takes the depth no further from its set-point for the temperature"""
    quality_temperature_min_c: NonNegativeFloat = weld.QUALITY_TEMPERATURE_MIN_C
    """an approach lets the depth give way before the temperature falls below, whatever the priority"""
    quality_temperature_max_c: NonNegativeFloat = weld.QUALITY_TEMPERATURE_MAX_C
    """an approach lets the depth give way before the temperature rises above, whatever the priority"""
    weight_depth_per_mm: NonNegativeFloat = 0.0
    """L1 weight outside the dead-band, per output point"""
    weight_temperature_per_c: NonNegativeFloat = 0.0
    """L1 weight outside the dead-band, per output point"""
    depth_scale_mm: NonNegativeFloat = 0.0022
    """quadratic cost, per output point: a deviation of this size from the trajectory costs 1/2; 0: none"""
    temperature_scale_c: NonNegativeFloat = 0.2
    """quadratic cost, per output point: a deviation of this size from the trajectory costs 1/2; 0: none"""
    yield_depth_mm: NonNegativeFloat = 0.0
    """where the temperature has priority: deviation of the depth beyond which its cost is linear; 0: never"""
    yield_temperature_c: NonNegativeFloat = 0.0
    """where the depth has priority (balance: twice this): deviation of the temperature beyond which its cost is linear;
    0: never, and the depth always waits for what the speed can compensate"""
    quality_weight_per_mm: NonNegativeFloat = 0.0
    """L1 weight of the depth outside its quality limits, at the ends of the blocks"""
    quality_weight_per_c: NonNegativeFloat = 0.0
    """L1 weight of the temperature outside its quality limits, at the ends of the blocks"""
    move_force_per_kn: NonNegativeFloat = 0.0
    """L1 weight on the moves of an interval"""
    move_speed_per_rpm: NonNegativeFloat = 0.0
    """L1 weight on the moves of an interval"""
    full_move_cost: NonNegativeFloat = 0.2
    """quadratic cost of an interval's move, twice that of the largest move, for both inputs"""
    blocks: Literal[20, 54] = 20
    """20: blocks of moves over the 54 intervals; 54: a move in every interval, as in the paper"""
    estimator: EstimatorTuning = EstimatorTuning()

    @model_validator(mode="after")
    def _check_approach(self) -> Tuning:
        for name in ("depth_time_s", "temperature_time_s"):
            if self.trajectory == "approach" and getattr(self, name) < 2 * STEP_S:
                raise problem(f"is {getattr(self, name):g}: an approach takes at least {2 * STEP_S} s", name)
        for name in ("yield_depth_mm", "yield_temperature_c"):
            if getattr(self, name) > 0.0 and (self.weight_depth_per_mm > 0.0 or self.weight_temperature_per_c > 0.0):
                raise problem("does not go with an L1 weight of the outputs", name)
        if self.yield_depth_mm > 0.0 and not self.depth_scale_mm > 0.0:
            raise problem("needs a depth_scale_mm", "yield_depth_mm")
        if self.yield_temperature_c > 0.0 and not self.temperature_scale_c > 0.0:
            raise problem("needs a temperature_scale_c", "yield_temperature_c")
        if self.quality_temperature_min_c >= self.quality_temperature_max_c:
            raise problem("is not above quality_temperature_min_c", "quality_temperature_max_c")
        return self

    @classmethod
    def preset(cls, name: str, parameters: ModelParameters) -> Tuning:
        """A named tuning for a model.

        Parameters
        ----------
        name : str
            ``default``: by rule from the model; ``adaptive``: likewise, and the output without priority gives way on
            the way to a set-point; ``paper``, also ``paper:offset_free``: (28)-(37), with estimated disturbances;
            ``paper:letter``: without, as in the paper.
        parameters : ModelParameters

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        if name in _APPROACH_PER_DEAD_TIME:
            time_s = max(_APPROACH_PER_DEAD_TIME[name] * parameters.dead_time_s, 2 * STEP_S)
            return (cls() if name == "default" else ADAPTIVE).changed(temperature_time_s=time_s)
        presets = {"paper": PAPER, "paper:offset_free": PAPER, "paper:letter": PAPER_LETTER}
        if name not in presets:
            raise ValueError(f"preset {name!r} is unknown; known: default, adaptive, {', '.join(presets)}")
        return presets[name]

    def with_knobs(
        self,
        depth_aggressiveness: float = 1.0,
        temperature_aggressiveness: float = 1.0,
        calmness: float = 1.0,
    ) -> Tuning:
        """Turn the knobs; 1 leaves the tuning as it is.

        Parameters
        ----------
        depth_aggressiveness, temperature_aggressiveness : float
            Divide the time constants of the trajectories.
        calmness : float
            Multiplies the cost of moves and divides the random walks of the estimator.
        """
        e = self.estimator
        walks = {name: value / calmness for name, value in e if "_walk" in name}
        return self.changed(
            depth_time_s=self.depth_time_s / depth_aggressiveness,
            temperature_time_s=self.temperature_time_s / temperature_aggressiveness,
            full_move_cost=self.full_move_cost * calmness,
            move_force_per_kn=self.move_force_per_kn * calmness,
            move_speed_per_rpm=self.move_speed_per_rpm * calmness,
            estimator=e.changed(**walks),
        )

    def _knees(self, priority: str) -> tuple[float, float]:
        """Deviations beyond which the cost of depth and temperature is linear, by who gives way."""
        depth_mm = self.yield_depth_mm if priority == "temperature" else 0.0
        return depth_mm, self.yield_temperature_c * {"depth": 1.0, "balance": 2.0, "temperature": 0.0}[priority]

    def struct(
        self,
        limits: Limits,
        max_iterations: int = _NODE["max_iterations"],
        plan_reuse: int = _NODE["plan_reuse"],
        blind_limit_s: float = _NODE["blind_limit"],
        priority: str = _NODE["priority"],
    ) -> Any:
        """The tuning as the library takes it."""
        e = self.estimator
        times = (self.depth_time_s, self.temperature_time_s)
        rate_memories_s = (e.depth_rate_memory_s, e.temperature_rate_memory_s)
        return KERNEL.new(
            "fsw_nmpc_tuning",
            trajectory=TRAJECTORIES.index(self.trajectory),
            priority=PRIORITIES.index(priority),
            max_iterations=max_iterations,
            plan_reuse=plan_reuse,
            time_s=times,
            corridor_decay=tuple(exp(-STEP_S / time_s) if time_s > 0.0 else 0.0 for time_s in times),
            dead_band=(self.dead_band_depth_mm, self.dead_band_temperature_c),
            quality_depth_mm=self.quality_depth_mm,
            quality_temp_c=(self.quality_temperature_min_c, self.quality_temperature_max_c),
            weight=(self.weight_depth_per_mm, self.weight_temperature_per_c),
            square=tuple(1.0 / s**2 if s > 0.0 else 0.0 for s in (self.depth_scale_mm, self.temperature_scale_c)),
            knee=self._knees(priority),
            held_share=_HELD_SHARE[priority] if self.yield_temperature_c > 0.0 else 1.0,
            window_weight=(self.quality_weight_per_mm, self.quality_weight_per_c),
            move_weight=(self.move_force_per_kn, self.move_speed_per_rpm),
            move_square=(self.full_move_cost / limits.force_step_kn**2, self.full_move_cost / limits.speed_step_rpm**2),
            move_max=(limits.force_step_kn, limits.speed_step_rpm),
            input_min=(limits.force_min_kn, limits.speed_min_rpm),
            input_max=(limits.force_max_kn, limits.speed_max_rpm),
            tolerance=1e-6,
            noise=(e.depth_noise_mm, e.torque_noise_nm, e.temperature_noise_c),
            walk=e.walks(),
            offset_keep=exp(-STEP_S / e.offset_memory_s) if e.offset_memory_s > 0.0 else 0.0,
            rate_keep=tuple(exp(-STEP_S / s) if s > 0.0 else 0.0 for s in rate_memories_s),
            jump_sigmas=e.jump_sigmas,
            drift_sigmas=e.drift_sigmas,
            heat_sigmas=e.heat_sigmas,
            blind_limit_s=blind_limit_s,
        )

    @classmethod
    def from_file(cls, path: str | Path, base: Tuning) -> Tuning:
        """Read a YAML file of fields over ``base``; those of the estimator are a mapping ``estimator``.

        Raises
        ------
        fsw_schema.models.InputError
            If the file cannot be read or something in it is wrong; the message is one line.
        """
        content = content_of(read_text(path, "tuning_file"), str(path))
        return validate(cls, _over(base.model_dump(), content), str(path))


def _over(base: dict[str, Any], content: Any) -> Any:
    """A mapping with the values of another in it, at all depths; anything else instead of it."""
    if not isinstance(content, Mapping):
        return content
    return base | {
        name: _over(base[name], value) if isinstance(base.get(name), dict) else value for name, value in content.items()
    }


#: As default; besides, the output without priority gives way on the way, inside the quality limits, and gain and delay
#: of the power are estimated, and heat that the model lacks is found. Values chosen on 60 random plants, the last one
#: on 12 canisters that conduct heat.
ADAPTIVE = Tuning(
    yield_depth_mm=0.005,
    temperature_scale_c=0.3,
    yield_temperature_c=1.0,
    quality_weight_per_mm=1e5,
    quality_weight_per_c=5e3,
    estimator=EstimatorTuning(
        heat_walk_kw=2e-4, depth_rate_memory_s=300.0, thermal_gain_walk=1e-3, delay_walk_s=2e-3, heat_sigmas=5.0
    ),
)
#: (28)-(37): L1 cost outside dead-bands about first-order corridors (32), (33), with the weights (37); constant offsets
PAPER = Tuning(
    trajectory="recentred",
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
        depth_rate_walk_mm_per_s=0.0, temperature_rate_walk_c_per_s=0.0, depth_gain_walk=0.0, drift_sigmas=0.0
    ),
)
#: To the letter: "no disturbance model". States of the process are estimated, nothing else.
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
