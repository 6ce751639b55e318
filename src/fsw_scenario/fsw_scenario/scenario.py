"""A scenario: what happens in a weld experiment, as validated data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from fsw_control.weld import TICK_S
from fsw_plant import PlantEvent
from fsw_scenario.weld_programme import Phase

#: Name of the controller in scenarios that drive the manipulated variables themselves.
OPEN_LOOP = "none"
_EPSILON_S = 1e-9


class ScenarioError(ValueError):
    """A scenario is wrong; the message says in which file, at which place, and what is allowed."""


def tick_of(at_s: float) -> int:
    """First tick whose stamp is at or after ``at_s``."""
    tick = round(at_s / TICK_S)
    return tick if tick * TICK_S >= at_s - _EPSILON_S else tick + 1


@dataclass(frozen=True, slots=True)
class Sine:
    """Sine about the set-point of a reference, from its event until the next one: amplitudes and period."""

    depth_mm: float
    temperature_c: float
    period_s: float


@dataclass(frozen=True, slots=True)
class ReferenceEvent:
    """New set-points; None keeps the present one.

    They are reached by a ramp of the length ``over_s`` (0: a step), and the sine on top begins after it.
    """

    at_s: float
    depth_mm: float | None = None
    temperature_c: float | None = None
    over_s: float = 0.0
    sine: Sine | None = None


@dataclass(frozen=True, slots=True)
class SwitchEvent:
    """Another controller is selected."""

    at_s: float
    controller: str


@dataclass(frozen=True, slots=True)
class CommandEvent:
    """New manipulated variables in an open-loop experiment; None keeps the present one."""

    at_s: float
    force_kn: float | None = None
    speed_rpm: float | None = None


Event = ReferenceEvent | PlantEvent | SwitchEvent | CommandEvent


@dataclass(frozen=True, slots=True)
class Scenario:
    """A weld experiment.

    Attributes
    ----------
    name, description : str
    duration_s : float
        Length of the experiment: ticks 1 (stamp 0.1 s) to ``n_ticks``.
    controller : str
        Selected at the start; ``OPEN_LOOP`` when the events drive the manipulated variables.
    plant : dict of str to value
        The plant's parameters that differ from their defaults, by dotted name.
    events : tuple of Event
        In order of time.
    figures : tuple of int
        The paper's figures that it shows.
    announced : bool
        Whether controllers know the set-points beforehand.
    phases : tuple of Phase
        Of a whole weld; its set-points are among the events.
    text : str
        The YAML it was read from, with all overrides applied.
    """

    name: str
    duration_s: float
    description: str = ""
    controller: str = "decentral"
    plant: dict[str, Any] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    figures: tuple[int, ...] = ()
    announced: bool = False
    phases: tuple[Phase, ...] = ()
    text: str = ""

    @property
    def n_ticks(self) -> int:
        """Number of ticks."""
        return round(self.duration_s / TICK_S)

    @property
    def open_loop(self) -> bool:
        """Whether the events drive the manipulated variables instead of a controller."""
        return self.controller == OPEN_LOOP

    @property
    def controllers(self) -> tuple[str, ...]:
        """Names of the controllers that are selected at some time, the first first."""
        names = [] if self.open_loop else [self.controller]
        names += [event.controller for event in self.events if isinstance(event, SwitchEvent)]
        return tuple(dict.fromkeys(names))
