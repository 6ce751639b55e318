"""Gain and delay margin of each loop, the other one closed, by simulation of small steps."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fsw_control.contract import Command, Controller
from fsw_model import STEP_S, ModelParameters, nominal
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make, name_of
from fsw_scenario.scenario_file import parse
from fsw_tuning.identification_design import plant_factors
from fsw_tuning.standard_cases import DEFAULT

#: steps of both set-points so small that the loop is linear
_SMALL_STEPS = """
name: small_steps
duration_s: 220.0
events:
  - {at_s: 2.0, reference: {depth_mm: 2.67}}
  - {at_s: 4.0, reference: {temperature_c: 816.9}}
"""
#: ticks of the two ends of a weld that are compared
_PART = 600
#: dead time that the model takes at most
_LONGEST_S = 10.0
#: factor on a gain up to which its margin is sought, and on the paper's value: the emulator takes
#: up to 10
LARGEST_GAIN, _LARGEST_FACTOR = 8.0, 9.9
_DEPTH, _TEMPERATURE = "depth_gain_mm_per_kn_s", "thermal_gain_c_per_kw"
TITLES = {
    "depth_gain": "depth: gain",
    "temperature_gain": "temperature: gain",
    "depth_delay_s": "depth: delay",
    "temperature_delay_s": "temperature: delay",
}
#: factors that are tried to match margins (chosen)
_SLOWER = tuple(1.12**k for k in range(14))
#: factor to which a gain margin is found
GAIN_ACCURACY = 1.02


class _LateForce:
    """A plant whose force drive receives its commands some ticks late."""

    def __init__(self, plant: Any, ticks: int) -> None:
        self._plant = plant
        self._under_way = deque([plant.applied.force_kn] * ticks)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def apply(self, command: Command, stamp_ns: int, source: str) -> None:
        self._under_way.append(command.force_kn)
        self._plant.apply(Command(self._under_way.popleft(), command.speed_rpm), stamp_ns, source)


@dataclass(slots=True)
class Loops:
    """A controller, by label with its node's parameters, and the process whose margins are sought.

    ``plant`` has parameters of drives and sensors that differ from their defaults, by their names
    in the plant's parameters.
    """

    label: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    process: ModelParameters = field(default_factory=nominal)
    plant: Mapping[str, float] = field(default_factory=dict)
    _controller: Controller = field(init=False)

    def __post_init__(self) -> None:
        self._controller = make(self.label, dict(self.parameters))

    def is_stable(self, force_ticks: int = 0, /, **factors: float) -> bool:
        """Whether small steps of both set-points die out, without noise.

        What swings by ten times the step and more does not die out, even if the bounds of the
        drives make it smaller.

        Parameters
        ----------
        force_ticks : int
            By which the force is late.
        **factors : float
            On parameters of the process.
        """
        # By simulation, as the NMPC has no transfer function. The steps are small, so that the
        # bounds of the drives do not act, and swings are compared with those a part earlier.
        plant = {**self.plant, **plant_factors(self.process.scaled(**factors))}
        overrides = [f"controller={name_of(self.label)}", "plant.noise=false"]
        overrides += [f"plant.{name}={json.dumps(of)}" for name, of in plant.items()]
        loop = ClosedLoop(
            parse(_SMALL_STEPS, "small_steps", overrides), {name_of(self.label): self._controller}
        )
        loop.plant = _LateForce(loop.plant, force_ticks)  # type: ignore[assignment]
        truth = loop.run().truth
        assert truth is not None  # a simulation has it
        if loop.plant.stopped:
            return False
        for value, floor, most in ((truth.depth_mm, 1e-4, 0.1), (truth.temperature_c, 1e-2, 5.0)):
            earlier, later = np.ptp(value[-2 * _PART : -_PART]), np.ptp(value[-_PART:])
            if later > min(max(0.9 * earlier, floor), most):
                return False
        return True

    def with_delay(self, more_s: float) -> bool:
        """Whether the loops are stable when the dead time of the temperature is longer."""
        return self.is_stable(
            dead_time_s=(self.process.dead_time_s + more_s) / self.process.dead_time_s
        )

    def has(self, gain: float, delay_s: float) -> bool:
        """Whether the loop of the temperature has at least these margins."""
        gain = min(gain, _most_gain(self.process, _TEMPERATURE))
        return self.is_stable(**{_TEMPERATURE: gain}) and self.with_delay(delay_s)

    def temperature(self) -> dict[str, float]:
        """Margins of the temperature's loop.

        Factor on the gain, inf beyond what is tried, and delay.
        """
        longest = _longest_ticks(self.process)
        delay = largest_delay(lambda ticks: self.with_delay(STEP_S * ticks), longest)
        return {"temperature_gain": self.gain(_TEMPERATURE), "temperature_delay_s": STEP_S * delay}

    def margins(self) -> dict[str, float]:
        """Margins of both loops."""
        delay = largest_delay(self.is_stable, _longest_ticks(self.process))
        return {
            "depth_gain": self.gain(_DEPTH),
            "depth_delay_s": STEP_S * delay,
            **self.temperature(),
        }

    def gain(self, name: str) -> float:
        """Margin of a gain of the process, by the name of the parameter.

        A factor, inf beyond what is tried.
        """
        return largest_gain(
            lambda gain: self.is_stable(**{name: gain}), _most_gain(self.process, name)
        )


def texts(margins: Mapping[str, float], process: ModelParameters | None = None) -> dict[str, str]:
    """Margins as texts.

    Larger ones are not distinguished, as the model takes dead times to 10 s.
    """
    process = process or nominal()
    longest_s = STEP_S * _longest_ticks(process)
    words = {}
    for name, margin in margins.items():
        if name.endswith("_gain"):
            most = _most_gain(process, _DEPTH if name.startswith("depth") else _TEMPERATURE)
            words[name] = f"> {most:.2g}" if math.isinf(margin) else f"{margin:.2g}"
        else:
            words[name] = f"{'≥ ' if margin > longest_s - 0.5 * STEP_S else ''}{margin:.1f} s"
    return words


def _longest_ticks(process: ModelParameters) -> int:
    """Largest delay, in ticks, for the search of a loop's margin."""
    return math.floor((_LONGEST_S - process.dead_time_s) / STEP_S + 1e-9)


def _most_gain(process: ModelParameters, name: str) -> float:
    """Largest factor on a process gain for the search of its margin."""
    usual: float = dict(nominal())[name]
    return min(LARGEST_GAIN, _LARGEST_FACTOR * usual / float(dict(process)[name]))


def slower_for(
    least: Mapping[str, float],
    parameters: Mapping[str, Any] | None = None,
    process: ModelParameters | None = None,
) -> float:
    """Factor on the NMPC's temperature time constant at which its margins are at least these.

    Or the largest factor that is tried; whether it is enough is for the caller to measure.
    """
    for slower in _SLOWER:
        own = {**(parameters or {}), "temperature_aggressiveness": 1.0 / slower}
        if Loops(DEFAULT, own, process or nominal()).has(
            least["temperature_gain"], least["temperature_delay_s"]
        ):
            break
    return slower


def largest_gain(stable: Callable[[float], bool], most: float = LARGEST_GAIN) -> float:
    """Largest factor on a gain at which the loop is stable, to 2 %; inf beyond ``most``."""
    # bisection in the logarithm, as the accuracy is relative
    if stable(most):
        return math.inf
    low, high = 1.0, most
    while high > GAIN_ACCURACY * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def largest_delay(stable: Callable[[int], bool], longest: int) -> int:
    """Largest number of ticks, up to ``longest``, at which ``stable`` holds."""
    # doubled until it fails, then bisection: a simulation for each step, so that few are better
    low, high = 0, 1
    while stable(high):
        if high == longest:
            return high
        low, high = high, min(2 * high, longest)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
