"""Known heat as the page draws it: a band over the canister's angle."""

from __future__ import annotations

from typing import Any

import numpy as np

from fsw_control.heat_plan import HeatPlan
from fsw_hmi.frames import readable, short
from fsw_model.heat_profile import CORRELATION_MM

#: distance of two places of the band (chosen: finer than what the heat is known for)
_STEP_DEG = 2.0
#: content of the frame without known heat
NO_HEAT: dict[str, Any] = {"type": "", "angle_deg": [], "heat_kw": [], "deviation_kw": []}


def heat_band(plan: HeatPlan | None) -> dict[str, Any]:
    """Heat and its standard deviation by angle; a plan that controllers refuse has none.

    What the plan lacks forgets over the correlation length, so that within it the variance of its
    change grows by twice its square.
    """
    if plan is None or plan.problem or not plan.angle_deg[-1] > plan.angle_deg[0]:
        return NO_HEAT
    turned_deg = np.maximum.accumulate(plan.angle_deg)
    angle_deg = np.arange(turned_deg[0], turned_deg[-1] + 1e-9, _STEP_DEG)
    travel_mm = np.interp(angle_deg, turned_deg, plan.travel_mm)
    half_mm = 0.5 * CORRELATION_MM
    low_mm = np.maximum(travel_mm - half_mm, plan.travel_mm[0])
    high_mm = np.minimum(travel_mm + half_mm, plan.travel_mm[-1])
    low, high = (np.interp(at, plan.travel_mm, plan.variance_kw2) for at in (low_mm, high_mm))
    per_mm = (high - low) / np.maximum(high_mm - low_mm, 1e-9)
    return {
        "type": readable(plan.type, 100),
        "angle_deg": [short(one) for one in angle_deg.tolist()],
        "heat_kw": [short(one) for one in np.interp(angle_deg, turned_deg, plan.heat_kw).tolist()],
        "deviation_kw": [short(one) for one in np.sqrt(per_mm * half_mm).tolist()],
    }
