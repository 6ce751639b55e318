"""The plant's watchdog: its reaction to missing commands."""

from __future__ import annotations

from enum import IntEnum

from fsw_model import STEP_S
from fsw_plant.config import PlantConfig

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
