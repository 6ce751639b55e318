"""What is refused before it is sent, with the reason."""

import pytest

from fsw_control.parameters import defaults
from fsw_control.ranges import REFERENCE_DEPTH_MM
from fsw_control.schema.models import InputError
from fsw_hmi.limits import reference
from fsw_hmi.refusals import why_not
from fsw_hmi.requests import ACTIONS, read
from fsw_supervisor.parameters import SupervisorParameters

TRIPS = defaults(SupervisorParameters)
STATE = {
    "target_controller": "nmpc",
    "actual_controller": "nmpc",
    "target_mode": "auto",
    "actual_mode": "auto",
}
STATE |= {"acknowledged": False, "controllers": [{"inhibited": False}]}
REPLACED = STATE | {"actual_controller": "decentral"}
INHIBITED = STATE | {"controllers": [{"inhibited": True}]}
STOPPED = STATE | {"actual_mode": "safe_stop", "target_mode": "safe_stop", "actual_controller": ""}
POINTS = {"depth_mm": 2.7, "temperature_c": 820.0}


@pytest.mark.parametrize(
    ("do", "content", "known", "told"),
    [
        ("set_reference", POINTS, {}, ""),
        ("set_reference", POINTS, {"depth_mm": 2.7, "temperature_c": 819.0}, ""),
        ("set_reference", POINTS, POINTS, "in_force"),
        (
            "set_reference",
            POINTS | {"depth_mm": 3.7},
            {"interlocks": TRIPS},
            "would_trip",
        ),
        ("switch", {"controller": "nmpc"}, {"state": STATE}, "commands_already"),
        ("switch", {"controller": "nmpc"}, {}, ""),
        ("switch", {"controller": "nmpc"}, {"state": REPLACED}, ""),
        ("switch", {"controller": "decentral"}, {"state": REPLACED}, ""),  # selects it, too
        ("mode", {"mode": "auto"}, {"state": STATE}, "auto_already"),
        ("mode", {"mode": "auto"}, {"state": INHIBITED}, ""),  # readmits it
        ("mode", {"mode": "auto"}, {"state": STOPPED}, ""),
        (
            "mode",
            {"mode": "hold"},
            {"state": STATE | {"actual_mode": "hold", "target_mode": "hold"}},
            "",
        ),  # lasts anew
        ("acknowledge_stop", {}, {"state": STATE}, "no_stop"),
        ("acknowledge_stop", {}, {"state": STOPPED}, ""),
        (
            "acknowledge_stop",
            {},
            {"state": STOPPED | {"acknowledged": True}},
            "stop_acknowledged",
        ),
    ],
)
def test_what_would_change_nothing_or_trip_is_refused(do, content, known, told):
    in_force = (known["depth_mm"], known["temperature_c"]) if "depth_mm" in known else None
    found = why_not(read(do, content), known.get("state"), in_force, known.get("interlocks", {}))
    assert (found.code if found else "") == told


@pytest.mark.requirement("S18")
@pytest.mark.parametrize("state", [None, STATE, STOPPED, STOPPED | {"acknowledged": True}])
def test_safe_stop_is_never_refused(state):
    assert why_not(ACTIONS["safe_stop"](), state, (2.66, 816.4), TRIPS) is None


@pytest.mark.parametrize(
    ("do", "content"),
    [
        ("disturb", {"channel": "depth", "shape": "step", "amplitude": 0}),
        ("disturb", {"channel": "torque", "shape": "pulse", "amplitude": -0.0, "duration_s": 1}),
        ("fault", {"sensor": "torque", "kind": "bias", "magnitude": 0}),
        ("fault", {"sensor": "depth", "kind": "spike"}),
    ],
)
def test_disturbance_of_nothing_is_refused(do, content):
    with pytest.raises(InputError, match="= 0 has no effect; 'none' ends a"):
        read(do, content)
    read(do, content | ({"shape": "none"} if do == "disturb" else {"kind": "none"}))


def test_form_has_the_limits_by_which_the_server_judges():
    whole, found = reference({}), reference(TRIPS)
    assert whole["depth_mm"] == [REFERENCE_DEPTH_MM.low, REFERENCE_DEPTH_MM.high]
    assert (found["depth_mm"][1], found["temperature_c"]) == (
        min(3.69, REFERENCE_DEPTH_MM.high),
        [790.1, 909.9],
    )
    for depth_mm, temperature_c in zip(found["depth_mm"], found["temperature_c"], strict=True):
        points = read("set_reference", {"depth_mm": depth_mm, "temperature_c": temperature_c})
        assert why_not(points, None, None, TRIPS) is None
