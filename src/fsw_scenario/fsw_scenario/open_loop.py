"""A scenario's command events as a controller."""

from __future__ import annotations

from fsw_control.contract import Command, Limits, Measurement, Proposal, Reference
from fsw_control.sensors import REQUIRED
from fsw_control.weld import TICK_S
from fsw_scenario.scenario import Scenario
from fsw_scenario.timeline import commands


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
