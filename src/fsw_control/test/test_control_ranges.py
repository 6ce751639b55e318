"""Which set-points may be asked for."""

import pytest

from fsw_control.ranges import beyond_trip

TRIPS = {"interlocks.depth_high.trip": 3.7, "interlocks.temperature_low.trip": 790.0}
TRIPS |= {"interlocks.temperature_high.trip": 910.0, "interlocks.temperature_high.warn": 800.0}


@pytest.mark.parametrize(
    ("depth_mm", "temperature_c", "facts"),
    [
        (2.66, 850.0, None),
        (3.69, 850.0, None),
        (3.7, 850.0, ("depth", 3.7, "mm", "above", 3.7)),
        (2.66, 790.0, ("temperature", 790.0, "°C", "below", 790.0)),
        (2.66, 911.0, ("temperature", 911.0, "°C", "above", 910.0)),
    ],
)
def test_set_points_beyond_a_trip_are_refused(depth_mm, temperature_c, facts):
    problem = beyond_trip(depth_mm, temperature_c, TRIPS)
    assert (problem and tuple(problem.data.values())) == facts
    assert problem is None or problem.code == "would_trip"
    assert beyond_trip(depth_mm, temperature_c, {}) is None
