"""The band of known heat by angle.

The profile's heat and deviation, none where there is no plan.
"""

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from fsw_control.heat_plan import HeatPlan
from fsw_hmi.frames import NO_HEAT, heat_band
from fsw_model.heat_profile import CORRELATION_MM

#: a dwell, then 920 mm and 100 deg with a deviation of 0.3 kW
TRAVEL_MM = np.concatenate([[0.0], np.linspace(0.0, 920.0, 461)])
PLAN = HeatPlan(
    at_s=np.arange(TRAVEL_MM.size).tolist(),
    heat_kw=(0.01 * TRAVEL_MM).tolist(),
    variance_kw2=(2.0 / CORRELATION_MM * 0.3**2 * TRAVEL_MM).tolist(),
    model={"copper_lag_s": 11.0},
    travel_mm=TRAVEL_MM.tolist(),
    angle_deg=(TRAVEL_MM / 9.2).tolist(),
    type="copper_lid",
)


def test_band_has_the_profiles_heat_and_deviation_by_angle():
    band = heat_band(PLAN)
    assert (band["type"], band["angle_deg"][0], band["angle_deg"][-1]) == ("copper_lid", 0.0, 100)
    assert band["heat_kw"] == pytest.approx([0.092 * deg for deg in band["angle_deg"]], rel=1e-3)
    assert band["deviation_kw"] == pytest.approx([0.3] * len(band["angle_deg"]), rel=1e-3)


@pytest.mark.parametrize(
    "plan",
    [None, replace(PLAN, heat_kw=[nan, *PLAN.heat_kw[1:]]), replace(PLAN, angle_deg=[])],
)
def test_without_a_plan_that_can_be_used_there_is_none(plan):
    assert heat_band(plan) == NO_HEAT
