"""What the page learns from the supervisor's parameters."""

from fsw_analysis.rule_book import default
from fsw_control.parameters import defaults
from fsw_hmi.limits import PARAMETERS, limits, safe_state
from fsw_supervisor.parameters import SupervisorParameters


def test_every_parameter_that_is_asked_for_is_the_supervisors():
    told = defaults(SupervisorParameters)
    known = {name: told[name] for name in PARAMETERS}
    assert safe_state(known) == {"force_kn": 65.0, "rate_kn_per_s": 2.0}
    assert limits(known, default())["force_kn"]["trip"] == [
        None,
        told["interlocks.force_high.trip"],
    ]


def test_safe_state_is_unknown_until_all_of_it_is_told():
    assert safe_state({"safe_force_kn": 65.0}) is None
