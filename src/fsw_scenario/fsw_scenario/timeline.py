"""A scenario by tick: set-points, open-loop commands and their controller, selected controller."""

from __future__ import annotations

from itertools import pairwise
from math import pi, sin

from fsw_control.contract import Command, Limits, Measurement, Proposal, Reference
from fsw_control.sensors import REQUIRED
from fsw_control.weld import TICK_S
from fsw_scenario.scenario import Scenario, tick_of

#: time for which a scenario's switch waits until its controller is ready [s]
SWITCH_TIMEOUT_S = 5.0


class OpenLoopController:
    """Proposes the commands of a scenario with ``controller: none``, whatever is measured.

    ``start`` is proposed before the first event; a step larger than a move limit takes several
    ticks. With ``from_first_tick`` the scenario's time counts from the first measurement (wall
    clock), otherwise from stamp 0 (simulated time).
    """

    name = "open_loop"
    tolerated_sensors: tuple[str, ...] = REQUIRED

    def __init__(self, scenario: Scenario, start: Command, from_first_tick: bool = False) -> None:
        self._changes = commands(scenario, start)
        self._wanted = start
        self._limits = Limits()
        self._begin_s: float | None = None if from_first_tick else 0.0
        self._next_tick = 0

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        """Return the proposal of this tick; see ``fsw_control.Controller``."""
        if self._begin_s is None:
            self._begin_s = measurement.time_s
        tick = round((measurement.time_s - self._begin_s) / TICK_S)
        for passed in range(self._next_tick, tick + 1):
            self._wanted = self._changes.get(passed, self._wanted)
        self._next_tick = max(self._next_tick, tick + 1)
        return Proposal(self._limits.clip(self._wanted, applied))

    def reset(self, applied: Command) -> None:
        """Nothing to reset: the proposals depend on the timeline alone."""


def references(scenario: Scenario, start: Reference) -> dict[int, Reference]:
    """Changes of the set-points by tick, in order; tick 0 is ``start``, before the first event.

    A tick without entry keeps the last set-points.
    """
    events = [
        (event.at_s, event.reference) for event in scenario.events if event.reference is not None
    ]
    begins = [tick_of(at_s) for at_s, _ in events]
    changes: dict[int, Reference] = {0: start}
    depth_mm, temperature_c = start.depth_mm, start.temperature_c
    for i, (at_s, event) in enumerate(events):
        end = begins[i + 1] if i + 1 < len(events) else scenario.n_ticks + 1
        from_depth, from_temperature = depth_mm, temperature_c
        to_depth = from_depth if event.depth_mm is None else event.depth_mm
        to_temperature = from_temperature if event.temperature_c is None else event.temperature_c
        ramp_end = tick_of(at_s + event.over_s)
        for tick in range(begins[i], end):
            since_s = tick * TICK_S - at_s
            if tick < ramp_end:
                share = max(0.0, since_s / event.over_s)
                depth_mm = from_depth + share * (to_depth - from_depth)
                temperature_c = from_temperature + share * (to_temperature - from_temperature)
                changes[tick] = Reference(depth_mm, temperature_c)
                continue
            depth_mm, temperature_c = to_depth, to_temperature
            if event.sine is None:
                changes[tick] = Reference(depth_mm, temperature_c)
                break
            swing = sin(2.0 * pi * (since_s - event.over_s) / event.sine.period_s)
            changes[tick] = Reference(
                depth_mm + event.sine.depth_mm * swing,
                temperature_c + event.sine.temperature_c * swing,
            )
    return {0: changes[0]} | {
        tick: new for (_, old), (tick, new) in pairwise(changes.items()) if new != old
    }


def commands(scenario: Scenario, start: Command) -> dict[int, Command]:
    """Changes of the open-loop inputs by tick; see :func:`references`."""
    changes = {0: start}
    present = start
    for event in scenario.events:
        if (new := event.command) is not None:
            present = Command(
                present.force_kn if new.force_kn is None else new.force_kn,
                present.speed_rpm if new.speed_rpm is None else new.speed_rpm,
            )
            changes[tick_of(event.at_s)] = present
    return changes


def switches(scenario: Scenario) -> dict[int, str]:
    """Newly selected controller by tick."""
    return {
        tick_of(event.at_s): event.switch for event in scenario.events if event.switch is not None
    }
