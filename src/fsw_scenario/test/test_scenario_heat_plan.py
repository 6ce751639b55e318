"""A heat profile on the way of a programme: by the tool's place, not by time.

And in the closed loop.
"""

import numpy as np
import pytest
import yaml

from fsw_control.schema.models import InputError
from fsw_model import nominal
from fsw_model.heat_profile import CORRELATION_MM, HeatProfile, HeatSource, ThermalModel
from fsw_nmpc import NmpcController
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.scenario_file import load, parse
from fsw_scenario.weld_programme_course import HeatAhead

DWELL_S, LENGTH_MM, SPEED_MM_PER_S = 6.0, 43.0, 86.0 / 60.0
WELD_S = DWELL_S + LENGTH_MM / SPEED_MM_PER_S
SCENARIO = parse(
    yaml.safe_dump(
        {
            "name": "short_way",
            "controller": "nmpc",
            "phases": [
                {"name": "dwell", "duration_s": DWELL_S},
                {"name": "start", "to_deg": 2.0, "length_mm": LENGTH_MM},
            ],
        }
    ),
    "short_way",
)


def profile(model=None):
    """A kilowatt more from the middle of the way to its end."""
    return HeatProfile(
        type="short",
        model=ThermalModel.of(model or nominal()),
        welds=(HeatSource(weld="C001", sha256="a" * 64),),
        travel_mm=(0.0, 0.5 * LENGTH_MM, LENGTH_MM),
        heat_kw=(2.0, 2.0, 3.0),
        deviation_kw=(0.1, 0.1, 0.1),
    )


def test_heat_follows_the_path():
    plan = HeatAhead(profile(), SCENARIO.phases).plan(100.0)
    middle_s = 0.5 * (DWELL_S + WELD_S)
    at_s = 100.0 + np.array(
        [-5.0, 0.0, DWELL_S, middle_s, 0.5 * (middle_s + WELD_S), WELD_S, 99.0]
    )
    assert [plan.heat(time_s) for time_s in at_s] == pytest.approx(
        [2.0, 2.0, 2.0, 2.0, 2.5, 3.0, 3.0]
    )


def test_heat_becomes_uncertain_along_the_path():
    """While the tool stands, as fast as at the paper's speed, as the canister warms."""
    plan = HeatAhead(profile(), SCENARIO.phases).plan(0.0)
    expected = 0.1 * np.sqrt(2.0 * SPEED_MM_PER_S / CORRELATION_MM)
    assert plan.deviation(DWELL_S + 3.0, DWELL_S + 4.0) == pytest.approx(expected, rel=1e-6)
    assert plan.deviation(1.0, 2.0) == pytest.approx(expected, rel=1e-6)


def test_scenario_without_phases_has_no_path():
    with pytest.raises(InputError, match="phases"):
        ClosedLoop(load("quick"), {"nmpc": NmpcController()}, profile())


def test_closed_loop_passes_the_heat_to_the_controller():
    """With the model of the profile; with another model it is other heat, which is not used."""
    plain, known, other = (
        ClosedLoop(SCENARIO, {"nmpc": NmpcController()}, heat).run()
        for heat in (None, profile(), profile(nominal().changed(copper_lag_s=11.0)))
    )
    before = plain.time_s < 0.5 * (DWELL_S + WELD_S)
    assert (known.speed_rpm[before] < plain.speed_rpm[before] - 0.5).any()
    assert "known_heat_share" in known.statuses["nmpc"].disturbances
    assert (other.speed_rpm == plain.speed_rpm).all()
    assert "known_heat_share" not in other.statuses["nmpc"].disturbances
