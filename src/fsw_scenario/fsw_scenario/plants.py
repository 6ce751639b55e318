"""The plant of a closed loop: the emulated one, or a process of the user."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple, Protocol, runtime_checkable

from fsw_control.contract import Command
from fsw_control.depth_fusion import DepthEstimate
from fsw_control.schema.models import InputError
from fsw_control.weld import TICK_NS
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule
from fsw_scenario.scenario import Scenario


def plant_of(scenario: Scenario) -> PlantEmulator:
    """The plant of a scenario, with its disturbances and faults."""
    return PlantEmulator(
        PlantConfig.from_values(scenario.plant), PlantSchedule.of(scenario.events, scenario.path)
    )


class Outputs(NamedTuple):
    """What the sensors show at a tick.

    Examples
    --------
    >>> import fsw
    >>> fsw.Outputs(depth_mm=2.66, temperature_c=816.4, torque_nm=1022.0).depth_mm
    2.66
    """

    depth_mm: float
    temperature_c: float
    torque_nm: float


@runtime_checkable
class Plant(Protocol):
    """Any process that force and speed act on, in ticks of 0.1 s.

    It has its own sensor noise, drives and disturbances, if any; a scenario gives the set-points.

    Examples
    --------
    >>> import fsw
    >>> class FirstOrder:
    ...     def start(self):
    ...         self.depth_mm = 2.66
    ...         return fsw.Command(78.4, 407.6), fsw.Outputs(2.66, 816.4, 1022.0)
    ...
    ...     def step(self, command):
    ...         goal_mm = 2.66 + 0.02 * (command.force_kn - 78.4)
    ...         self.depth_mm += 0.02 * (goal_mm - self.depth_mm)
    ...         return fsw.Outputs(self.depth_mm, 816.4, 1022.0)
    >>> step = {"at_s": 5.0, "reference": {"depth_mm": 2.76}}
    >>> scenario = {"name": "mine", "duration_s": 30.0, "events": [step]}
    >>> weld = fsw.simulate(scenario, "decentral", plant=FirstOrder())
    >>> round(float(weld["depth_mm"][-1]), 2)
    2.76
    """

    def start(self) -> tuple[Command, Outputs]:
        """Begin a weld: the command in force, and what the sensors show at the first tick."""
        ...

    def step(self, command: Command) -> Outputs:
        """Hold a command, clipped to the limits, for a tick; what the sensors show after it."""
        ...


class _Reading(NamedTuple):
    stamp_ns: int
    values: dict[str, float]
    drives: Command
    fused: DepthEstimate | None = None  #: a user's process has one depth sensor


#: parameters of the emulated plant that say nothing about its process, or only where it starts
_HARMLESS = ("seed", "noise", "start.")


class OwnPlant:
    """Lets a closed loop run a user's process as it runs the emulated plant.

    Raises
    ------
    InputError
        If the scenario needs the emulated plant, or the process returns something else than a
        command and finite outputs.
    """

    stopped = ""  #: unlike the emulated plant it ends a weld by an exception only

    def __init__(self, process: Plant, scenario: Scenario) -> None:
        needs = [name for name in scenario.plant if not name.startswith(_HARMLESS)]
        needs = [f"plant.{name}" for name in needs]
        if any(event.disturbance or event.fault for event in scenario.events):
            needs.append("disturbances and faults")
        if needs:
            raise InputError(f"{scenario.name}: its {', '.join(needs)} need the emulated plant")
        if isinstance(process, type):
            raise InputError(
                f"plant: an object with start() and step(), not the class {process!r}"
            )
        self._process = process
        begun = process.start()  # an error in it is the user's, with its traceback
        try:
            command, outputs = begun
            self.applied = Command(*map(float, command))
        except (TypeError, ValueError) as error:
            raise InputError(f"plant: start() returns a Command and Outputs: {error}") from None
        if not all(map(isfinite, self.applied)):
            raise InputError(f"plant: start() returned {self.applied}, which is not finite")
        self._tick, self._outputs = 1, _checked(outputs, "start")

    def measure(self) -> _Reading:
        """Samples by sensor at the present tick."""
        depth_mm, temperature_c, torque_nm = self._outputs
        values = {"depth": depth_mm, "torque": torque_nm, "thermocouple": temperature_c}
        return _Reading(self._tick * TICK_NS, values, self.applied)

    def apply(self, command: Command, stamp_ns: int, source: str) -> None:
        """Command for the next step."""
        self.applied = command

    def step(self) -> None:
        """Advance by a tick."""
        self._outputs = _checked(self._process.step(self.applied), "step")
        self._tick += 1


def _checked(outputs: Outputs, method: str) -> Outputs:
    try:
        shown = Outputs(*map(float, outputs))
    except (TypeError, ValueError):
        raise InputError(
            f"plant: {method}() returns depth_mm, temperature_c, torque_nm, not {outputs!r}"
        ) from None
    if not all(map(isfinite, shown)):
        raise InputError(f"plant: {method}() returned {shown}, which is not finite")
    return shown
