"""Settings of the pair's world: times shortened, so that a few ticks lead everywhere."""

from __future__ import annotations

from fsw_control.contract import Command
from fsw_control.parameters import defaults, load
from fsw_plant.config import PlantConfig
from fsw_supervisor.settings import ArbiterSettings

HOME = Command(78.0, 400.0)  #: where the weld begins
NAMES = ("decentral", "nmpc")
#: what the sensors show [mm, N m]; the temperature is the world's
DEPTH_MM, TORQUE_NM = 2.66, 980.0
#: what a kN more adds to the torque at the paper's operating point [N m]
TORQUE_NM_PER_KN = 12.84
_SUPERVISOR = {
    "warm_ticks": 2,
    "readmit_ticks": 3,
    "start_timeout_s": 2.0,
    "hold_timeout_s": 1.0,
    "operator_hold_timeout_s": 2.0,
    "transition_ticks": 2,
    "takeover_wait_s": 0.1,
    "first_report_wait_s": 0.2,
    "safe_force_kn": 75.0,
    "safe_rate_kn_per_s": 10.0,
    # These have tests of their own: here the drives move at once, which no process does.
    "blind_limit_s": 3600.0,
    "validity.torque.max_jump": 1000.0,
    **{
        f"interlocks.{value}_model_{side}.{level}": sign * limit
        for value in ("torque", "depth", "temperature")
        for side, sign in (("low", -1.0), ("high", 1.0))
        for level, limit in (("warn", 900.0), ("trip", 1000.0))
    },
}
_PLANT = {"watchdog": {"timeout_s": 0.5, "hold_s": 0.5, "safe_force_kn": 70.0, "safe_rate_kn_per_s": 4.0}}
SETTINGS = ArbiterSettings.from_values(_SUPERVISOR)
VALUES = defaults(load("fsw_supervisor", "supervisor.yaml")) | _SUPERVISOR
CONFIG = PlantConfig.from_values(_PLANT)
