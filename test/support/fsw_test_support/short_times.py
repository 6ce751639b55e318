"""Settings that the welding cell and the pair share.

Times shortened, so that a few ticks lead everywhere.
"""

from __future__ import annotations

from typing import Any

from fsw_control.contract import Command

HOME = Command(78.0, 400.0)  #: where the controllers want to be
NAMES = ("decentral", "nmpc")
#: what a kN more adds to the torque at the paper's operating point [N m]
TORQUE_NM_PER_KN = 12.84


def any_residual(*values: str) -> dict[str, float]:
    """Parameters of the supervisor under which values may be as far from their model as they like."""
    return {
        f"interlocks.{value}_model_{side}.{level}": sign * limit
        for value in values
        for side, sign in (("low", -1.0), ("high", 1.0))
        for level, limit in (("warn", 900.0), ("trip", 1000.0))
    }


#: parameters of the supervisor
SUPERVISOR: dict[str, Any] = {
    "warm_ticks": 2,
    "readmit_ticks": 3,
    "transition_ticks": 2,
    "takeover_wait_s": 0.1,
    "first_report_wait_s": 0.2,
    "safe_force_kn": 75.0,
    "safe_rate_kn_per_s": 10.0,
    # These have tests of their own: here the drives move at once, which no process does.
    "blind_limit_s": 3600.0,
    "validity.torque.max_jump": 1000.0,
    **any_residual("torque", "depth", "temperature"),
}
