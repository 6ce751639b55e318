"""What the page learns from the supervisor's parameters."""

from fsw_analysis.rule_book import default
from fsw_control.parameters import defaults
from fsw_control.ranges import REFERENCE_DEPTH_MM, beyond_trip
from fsw_hmi.limits import PARAMETERS, limits, reference, safe_state
from fsw_supervisor.parameters import SupervisorParameters


def test_every_parameter_that_is_asked_for_is_the_supervisors():
    values = defaults(SupervisorParameters)
    known = {name: values[name] for name in PARAMETERS}
    assert safe_state(known) == {"force_kn": 65.0, "rate_kn_per_s": 2.0}
    assert limits(known, default())["force_kn"]["trip"] == [
        None,
        values["interlocks.force_high.trip"],
    ]


def test_safe_state_is_unknown_until_all_of_it_is_told():
    assert safe_state({"safe_force_kn": 65.0}) is None


def test_form_has_the_limits_by_which_the_supervisor_judges():
    trips = defaults(SupervisorParameters)
    whole, narrowed = reference({}), reference(trips)
    assert whole["depth_mm"] == [REFERENCE_DEPTH_MM.low, REFERENCE_DEPTH_MM.high]
    assert (narrowed["depth_mm"][1], narrowed["temperature_c"]) == (
        min(3.69, REFERENCE_DEPTH_MM.high),
        [790.1, 909.9],
    )
    for depth_mm, temperature_c in zip(
        narrowed["depth_mm"], narrowed["temperature_c"], strict=True
    ):
        assert beyond_trip(depth_mm, temperature_c, trips) is None
