"""A weld as an environment of Gymnasium, ``fsw/Weld-v0``, alone and many at once.

And a policy as a controller.

``gymnasium.make("fsw_lab.weld_env:fsw/Weld-v0")`` needs no import before it; Gymnasium 1.0 has
given up entry points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import Env, spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from fsw.controller import Controller
from fsw.simulation import overrides_of
from fsw_control import Command, Measurement, Reference, weld
from fsw_control.schema.models import InputError
from fsw_lab.plant_batch import CHANNELS, PlantBatch
from fsw_model import STEP_S
from fsw_plant import PlantConfig
from fsw_scenario.plants import plant_of
from fsw_scenario.scenario import Scenario, start_reference
from fsw_scenario.scenario_file import load
from fsw_scenario.timeline import references

Array = NDArray[np.float64]
#: What an observation holds, in this order, and by which origin and unit each number is scaled
#: (chosen).
OBSERVED = {
    "depth_mm": (weld.DEPTH_MM, 0.1),
    "torque_nm": (1050.0, 50.0),
    "temperature_c": (weld.TEMPERATURE_C, 10.0),
    "force_kn": (weld.FORCE_KN, 2.0),
    "speed_rpm": (weld.SPEED_RPM, 20.0),
    "reference_depth_mm": (weld.DEPTH_MM, 0.1),
    "reference_temperature_c": (weld.TEMPERATURE_C, 10.0),
}
_ORIGIN, _UNIT = (np.array(column)[:, None] for column in zip(*OBSERVED.values(), strict=True))
#: Errors that cost 1 per second, and what it costs to lose the copper (chosen).
COST_MM, COST_C, LOST = 0.1, 5.0, 100.0
_STEP = np.array([[weld.FORCE_STEP_KN], [weld.SPEED_STEP_RPM]])
_LOW, _HIGH = (
    np.array([[force], [speed]])
    for force, speed in (
        (weld.FORCE_MIN_KN, weld.SPEED_MIN_RPM),
        (weld.FORCE_MAX_KN, weld.SPEED_MAX_RPM),
    )
)
#: observations are kept within this, far from any weld (chosen)
_MOST = 50.0
OBSERVATION = spaces.Box(-_MOST, _MOST, (len(OBSERVED),), np.float32)
ACTION = spaces.Box(-1.0, 1.0, (2,), np.float32)


def observation(values: Array) -> NDArray[np.float32]:
    """Scale values in the order of ``OBSERVED``, (7, n), to observations, (n, 7)."""
    scaled: NDArray[np.float32] = np.clip((values - _ORIGIN) / _UNIT, -_MOST, _MOST).T.astype(
        np.float32
    )
    return scaled


def command(action: Array, before: Array) -> Array:
    """Commands (2, n) by actions (n, 2), shares of the largest step, and earlier commands."""
    wanted = (
        before + np.clip(np.nan_to_num(np.asarray(action, dtype=np.float64).T), -1.0, 1.0) * _STEP
    )
    limited: Array = np.minimum(np.maximum(wanted, _LOW), _HIGH)
    return limited


if "fsw/Weld-v0" not in gymnasium.registry:
    gymnasium.register(
        id="fsw/Weld-v0",
        entry_point=f"{__name__}:WeldEnv",
        vector_entry_point=f"{__name__}:WeldVectorEnv",
    )


class _Welds:
    """``n`` welds of a scenario, without any interface."""

    def __init__(
        self, scenario: str | Path, plant: Mapping[str, Any] | None, noise: bool, n: int
    ) -> None:
        made = load(scenario, overrides_of(plant, None, noise))
        config = PlantConfig.from_values(made.plant)
        if config.canister is not None or any(event.fault is not None for event in made.events):
            raise InputError(
                f"{made.name}: fsw/Weld-v0 has the paper's process and no sensor faults"
            )
        self.n_ticks = made.n_ticks
        self.reference, disturbances = _course(made)
        self.plants = PlantBatch(config, n, disturbances)
        start = self.plants.start
        self._start = np.array([[start.force_kn], [start.speed_rpm]])
        self.before = np.tile(self._start, n)
        self.iae = np.zeros((2, n))

    def reset(self, which: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        self.plants.reset(which, seeds)
        self.before[:, which] = self._start
        self.iae[:, which] = 0.0
        self.iae[:, which] = self._add_errors()[:, which]

    def _add_errors(self) -> Array:
        depth, temperature = self.plants.truth()
        wanted = self.reference[:, self.plants.tick]
        return np.abs(np.stack([depth, temperature]) - wanted) * STEP_S

    def observe(self) -> NDArray[np.float32]:
        shown, wanted = self.plants.measure(), self.reference[:, self.plants.tick]
        return observation(np.concatenate([shown, self.plants.acting, wanted]))

    def step(self, action: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """Reward, and whether each weld is lost, and over."""
        self.before = command(action, self.before)
        self.plants.step(self.before)
        errors = self._add_errors()
        self.iae += errors
        lost = self.plants.stopped
        reward = -(errors[0] / COST_MM + errors[1] / COST_C) - np.where(lost, LOST, 0.0)
        return reward, lost.copy(), (self.plants.tick >= self.n_ticks) & ~lost

    def kpi(self) -> dict[str, Array]:
        """Integrals of absolute errors so far, named as by :func:`fsw_analysis.kpi.compute`."""
        return {"iae_depth_mm_s": self.iae[0].copy(), "iae_temperature_c_s": self.iae[1].copy()}


def _course(scenario: Scenario) -> tuple[Array, Array]:
    """Set-points (2, n_ticks + 2) and disturbances (n_ticks + 2, 6) by tick."""
    wanted = np.empty((2, scenario.n_ticks + 2))
    steps = references(scenario, start_reference(scenario.plant))
    for tick, reference in steps.items():
        wanted[:, max(tick, 0) :] = np.array([[reference.depth_mm], [reference.temperature_c]])
    disturbances, plant = np.zeros((scenario.n_ticks + 2, len(CHANNELS))), plant_of(scenario)
    for tick in range(1, scenario.n_ticks + 2):
        plant.measure()
        for each in plant.disturbances.values():
            disturbances[tick, CHANNELS.index(each.target)] += each.value(plant.time_s)
        plant.apply(plant.applied)
        plant.step()
    return wanted, disturbances


class WeldEnv(Env[NDArray[np.float32], NDArray[np.float32]]):
    """One weld of a scenario, a step per tick of 0.1 s.

    An action is the change of force and speed, each a share (-1 to 1) of the largest step that the
    drives can make in a tick. An observation has the sensors, the drives' feedback and the
    set-points (``OBSERVED``). Power acts on the temperature after 2.8 s, so an observation is not
    the whole state: stack several, or use a policy with memory. The reward is the negative sum of
    both absolute errors, weighed, integrated over time. A weld ends with the scenario (truncated),
    or when the tool leaves the copper (terminated). ``info["kpi"]`` at the end has figures of
    merit as the comparison of the controllers has them.

    Parameters
    ----------
    scenario : str or Path
        Without faults, e.g. ``reference_tracking``.
    plant : mapping of str to value, optional
        Parameters of the plant, e.g. ``{"factors.thermal_gain_c_per_kw": 1.2}``.
    noise : bool
        Whether sensors have noise and resolution.

    Raises
    ------
    fsw_control.schema.models.InputError
        When the scenario cannot be had or used.

    Examples
    --------
    >>> import gymnasium
    >>> import fsw_lab.weld_env
    >>> env = gymnasium.make("fsw/Weld-v0", scenario="quick")
    >>> seen, info = env.reset(seed=1)
    >>> seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
    >>> seen.shape, terminated
    ((7,), False)
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        scenario: str | Path = "reference_tracking",
        plant: Mapping[str, Any] | None = None,
        noise: bool = True,
        render_mode: str | None = None,
    ) -> None:
        self._welds = _Welds(scenario, plant, noise, 1)
        self.observation_space, self.action_space = OBSERVATION, ACTION
        self.render_mode = render_mode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a weld; the noise of its sensors follows from ``seed``."""
        super().reset(seed=seed)
        self._welds.reset(np.zeros(1, dtype=np.int64), self.np_random.integers(2**31, size=1))
        return self._welds.observe()[0], {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One tick."""
        reward, lost, over = self._welds.step(np.asarray(action, dtype=np.float64)[None])
        seen = self._welds.observe()[0]
        info = {}
        if lost[0] or over[0]:
            info = {"kpi": {name: float(value[0]) for name, value in self._welds.kpi().items()}}
        return seen, float(reward[0]), bool(lost[0]), bool(over[0]), info


class WeldVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """Many welds of a scenario at once, see :class:`WeldEnv`.

    One that has ended begins again at the next step.

    Examples
    --------
    >>> import gymnasium
    >>> import fsw_lab.weld_env
    >>> kind = {"num_envs": 8, "vectorization_mode": "vector_entry_point"}
    >>> envs = gymnasium.make_vec("fsw/Weld-v0", **kind, scenario="quick")
    >>> seen, info = envs.reset(seed=1)
    >>> seen.shape
    (8, 7)
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Path = "reference_tracking",
        plant: Mapping[str, Any] | None = None,
        noise: bool = True,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs, self.render_mode = num_envs, render_mode
        self._welds = _Welds(scenario, plant, noise, num_envs)
        self.single_observation_space, self.single_action_space = OBSERVATION, ACTION
        self.observation_space, self.action_space = (
            batch_space(space, num_envs) for space in (OBSERVATION, ACTION)
        )
        self._ended = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin all welds; with several seeds, the first counts."""
        super().reset(seed=seed[0] if isinstance(seed, list) else seed)
        self._begin(np.arange(self.num_envs))
        return self._welds.observe(), {}

    def _begin(self, which: NDArray[np.int64]) -> None:
        self._welds.reset(which, self.np_random.integers(2**31, size=len(which)))
        self._ended[which] = False

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One tick of all; those that had ended begin again instead."""
        again = np.flatnonzero(self._ended)
        reward, lost, over = self._welds.step(actions.astype(np.float64))
        if again.size:
            self._begin(again)
            reward[again], lost[again], over[again] = 0.0, False, False
        self._ended = lost | over
        info: dict[str, Any] = {}
        if self._ended.any():
            info = {"kpi": self._welds.kpi(), "_kpi": self._ended.copy()}
        return self._welds.observe(), reward, lost, over, info


class PolicyController(Controller):
    """A learned policy as a controller, to be compared with the others.

    ``fsw.compare("quick", ["nmpc", controller])``.

    Parameters
    ----------
    policy : callable
        From an observation (7,) to an action (2,), as in :class:`WeldEnv`.
    name : str
        In tables.

    Examples
    --------
    >>> import fsw, fsw_lab.weld_env
    >>> policy = lambda seen: [5 * (seen[5] - seen[0]) - 2 * seen[3], 0.0]
    >>> controller = fsw_lab.weld_env.PolicyController(policy)
    >>> fsw.simulate("quick", controller).kpi["iae_depth_mm_s"] < 3.0
    True
    """

    def __init__(self, policy: Callable[[NDArray[np.float32]], Any], name: str = "policy") -> None:
        self.name, self._policy = name, policy

    def command(self, measurement: Measurement, reference: Reference, applied: Command) -> Command:
        """The command by the policy's action."""
        values = [
            measurement.depth_mm,
            measurement.torque_nm,
            measurement.temperature_c,
            measurement.force_kn,
            measurement.speed_rpm,
            reference.depth_mm,
            reference.temperature_c,
        ]
        action = np.asarray(self._policy(observation(np.array(values)[:, None])[0]))
        return Command(*command(action[None], np.array(applied)[:, None])[:, 0].tolist())
