"""The plant's watchdog: what happens when commands stay away."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class WatchdogState(IntEnum):
    """States, with the numbers of ``PlantState.WATCHDOG_*``."""

    OK = 0
    HOLD = 1
    SAFE = 2


@dataclass(frozen=True, slots=True)
class WatchdogConfig:
    """Settings, see ``plant.yaml`` for units, ranges and meaning."""

    timeout_s: float
    hold_s: float
    safe_force_kn: float
    safe_rate_kn_per_s: float
    armed_at_start: bool


class Watchdog:
    """Counts the time since the last valid command.

    OK until ``timeout_s`` without a valid command; then HOLD: the last command stays; after another ``hold_s`` SAFE:
    the force goes down to ``safe_force_kn`` at ``safe_rate_kn_per_s`` (a lower force stays) and the spindle keeps the
    speed it has. A valid command ends both at once. Before the first valid command it holds and does not go to
    SAFE, unless ``armed_at_start``.
    """

    def __init__(self, config: WatchdogConfig) -> None:
        self.config = config
        self.state = WatchdogState.OK
        self.age_s = 0.0
        self.armed = config.armed_at_start

    def feed(self) -> None:
        """A valid command has come."""
        self.age_s = 0.0
        self.armed = True
        self.state = WatchdogState.OK

    def advance(self, force_kn: float, step_s: float) -> float:
        """Decide for the step that begins now, and count it.

        Parameters
        ----------
        force_kn : float
            Force that is wanted now.
        step_s : float
            Length of the step.

        Returns
        -------
        float
            Force to want instead.
        """
        config = self.config
        age = self.age_s + 1e-9
        if age >= config.timeout_s:
            safe = self.armed and age >= config.timeout_s + config.hold_s
            self.state = WatchdogState.SAFE if safe else WatchdogState.HOLD
            if safe and force_kn > config.safe_force_kn:
                force_kn = max(config.safe_force_kn, force_kn - config.safe_rate_kn_per_s * step_s)
        self.age_s += step_s
        return force_kn
