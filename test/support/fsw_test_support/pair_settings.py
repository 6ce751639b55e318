"""Settings of the pair's world: times shortened, so that a few ticks lead everywhere."""

from __future__ import annotations

from fsw_plant.config import PlantConfig
from fsw_supervisor.parameters import SupervisorParameters
from fsw_test_support.short_times import HOME, NAMES, SUPERVISOR, TORQUE_NM_PER_KN

__all__ = [
    "CONFIG",
    "DEPTH_MM",
    "HOME",
    "NAMES",
    "SETTINGS",
    "TORQUE_NM",
    "TORQUE_NM_PER_KN",
]

#: what the sensors show [mm, N m]; the temperature is the world's
DEPTH_MM, TORQUE_NM = 2.66, 980.0
_SUPERVISOR = SUPERVISOR | {
    "start_timeout_s": 2.0,
    "hold_timeout_s": 1.0,
    "operator_hold_timeout_s": 2.0,
}
_PLANT = {
    "watchdog": {"timeout_s": 0.5, "hold_s": 0.5, "safe_force_kn": 70.0, "safe_rate_kn_per_s": 4.0}
}
SETTINGS = SupervisorParameters.from_values(_SUPERVISOR)
CONFIG = PlantConfig.from_values(_PLANT)
