"""Values of the server: used, or NaN with a reason; never zero."""

from math import inf, isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_machine.samples import RawValue, bit, sample

NOW_NS = 1_700_000_000_000_000_000
BAD, UNCERTAIN = 0x80310000, 0x40900000


def raw(value, age_s=0.0, **given):
    return RawValue(value, source_ns=NOW_NS - round(age_s * 1e9), **given)


@pytest.mark.parametrize("value", [2.66, 3, -1.0, 0.0])
def test_a_good_number_is_used(machine, value):
    for age_s in (0.2, 0.0, -0.04):
        assert sample(raw(value, age_s), machine.nodes["depth"], NOW_NS) == (value, "")


@pytest.mark.parametrize(
    ("value", "fact"),
    [
        (raw(2.66, status=BAD, status_name="BadNoCommunication"), "status BadNoCommunication"),
        (
            raw(2.66, status=UNCERTAIN, status_name="UncertainLastUsableValue"),
            "status UncertainLastUsableValue",
        ),
        (raw(2.66, age_s=0.3), "0.30 s older"),
        (raw(2.66, age_s=-0.1), "0.10 s newer"),
        (RawValue(2.66), "source timestamp"),
        (raw(nan), "not finite"),
        (raw(inf), "not finite"),
        (raw(None), "empty,"),
        (raw("2.66"), "a str,"),
        (raw(True), "a bool,"),
        (raw([2.66]), "a list,"),
    ],
)
def test_any_other_is_invalid_and_not_zero(machine, value, fact):
    read = sample(value, machine.nodes["depth"], NOW_NS)
    assert isnan(read.value) and fact in read.fault


@pytest.mark.parametrize(("value", "expected"), [(True, 1.0), (False, 0.0)])
def test_a_bit(machine, value, expected):
    for age_s in (0.2, 0.0, -0.04):
        assert bit(raw(value, age_s), machine.nodes["permissive"], NOW_NS) == (expected, "")


@pytest.mark.parametrize(
    "value", [raw(1), raw(None), raw("true"), raw(True, age_s=1.0), raw(True, status=BAD)]
)
def test_a_bit_that_is_not_clearly_one(machine, value):
    read = bit(value, machine.nodes["permissive"], NOW_NS)
    assert isnan(read.value) and len(read.fault) > 5


@given(
    value=st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text()
    | st.lists(st.floats(), max_size=2),
    status=st.integers(0, 2**32 - 1),
    age_ns=st.none() | st.integers(-(10**10), 10**10),
)
def test_a_value_is_used_or_says_why_not(machine, value, status, age_ns):
    raw_value = RawValue(value, status, "Some", None if age_ns is None else NOW_NS - age_ns)
    for judge, name in ((sample, "depth"), (bit, "permissive")):
        read = judge(raw_value, machine.nodes[name], NOW_NS)
        assert isnan(read.value) == bool(read.fault)
        if not read.fault:
            assert status < 1 << 30 and age_ns is not None and -50_000_000 <= age_ns <= 250_000_000
