"""Parameter files: what they may hold, what is refused, what is made of them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control import parameters
from fsw_control.parameters import ParameterSpec
from fsw_schema.models import InputError

TEXT = """
deadline:
  type: double
  default_value: 1
  description: "Wait so long"
  unit: "s"
  range: [0.5, 2]
loops.count:
  type: int
  default_value: 3
  description: "How many"
kind:
  type: string
  default_value: a
  description: "Which"
  options: [a, b]
  read_only: true
names:
  type: string_array
  default_value: []
  description: "Who"
weights:
  type: double_array
  default_value: [1, 2.5]
  description: "How much | of each"
  range: [0, 10]
enabled:
  type: bool
  default_value: false
  description: "Whether"
"""


def test_reads_every_type():
    specs = parameters.parse(TEXT)
    assert parameters.defaults(specs) == {
        "deadline": 1.0,
        "loops.count": 3,
        "kind": "a",
        "names": [],
        "weights": [1.0, 2.5],
        "enabled": False,
    }
    assert isinstance(specs["deadline"].default, float)
    assert specs["kind"].read_only and not specs["deadline"].read_only


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: [", "not valid YAML"),
        ("- a", "must map"),
        ("a: 1", "must be a mapping"),
        ("1a: {type: int, default_value: 1, description: x}", "not a parameter name"),
        ("a: {type: int, default_value: 1, description: x, rnage: [0, 1]}", "unknown keys rnage"),
        ("a: {type: int, description: x}", "lacks default_value"),
        ("a: {type: float, default_value: 1, description: x}", "type 'float'"),
        ("a: {type: int, default_value: 1.5, description: x}", "default_value of a"),
        ("a: {type: int, default_value: 5, description: x, range: [0, 1]}", "outside 0 to 1"),
        ("a: {type: int, default_value: 0, description: x, range: [1, 0]}", "min before max"),
        ("a: {type: int, default_value: 0, description: x, range: [0, .nan]}", "two finite"),
        ("a: {type: string, default_value: s, description: x, range: [0, 1]}", "numeric type"),
        ("a: {type: string, default_value: s, description: x, options: [t]}", "not one of t"),
        ("a: {type: string, default_value: s, description: x, options: s}", "list of strings"),
        ("a: {type: int, default_value: 1, description: x, options: [t]}", "need type string"),
        ("a: {type: bool, default_value: 1, description: x}", "not true or false"),
        ("a: {type: bool, default_value: true, description: x, read_only: 3}", "read_only"),
        ("a: {type: double, default_value: .nan, description: x}", "not finite"),
        ("a: {type: double_array, default_value: 3, description: x}", "not a list"),
    ],
)
def test_refuses_with_the_place_and_the_cause(text, said):
    with pytest.raises(InputError, match=said) as caught:
        parameters.parse(text, "somewhere.yaml")
    assert "somewhere.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_package_and_file_are_told():
    with pytest.raises(InputError, match="no_such_package"):
        parameters.load("no_such_package", "x.yaml")
    with pytest.raises(InputError, match=r"x\.yaml"):
        parameters.load("fsw_control", "x.yaml")
    with pytest.raises(InputError, match="cannot read"):
        parameters.load_path("/nonexistent/x.yaml")


def test_empty_file_describes_nothing(tmp_path):
    (tmp_path / "empty.yaml").write_text("")
    assert parameters.load_path(tmp_path / "empty.yaml") == {}


def test_validate_completes_and_refuses_unknown_names():
    specs = parameters.parse(TEXT)
    assert parameters.validate(specs, {"deadline": 2})["deadline"] == 2.0
    with pytest.raises(InputError, match=r"parameters dead_line; .* deadline"):
        parameters.validate(specs, {"dead_line": 2})


@given(
    value=st.one_of(
        st.floats(), st.integers(), st.text(), st.booleans(), st.none(), st.lists(st.floats())
    )
)
def test_a_checked_number_is_finite_and_in_range(value):
    spec = ParameterSpec("x", "double", 1.0, "", range=(0.0, 2.0))
    try:
        checked = spec.check(value)
    except InputError:
        assert not (
            isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value <= 2.0
        )
    else:
        assert (
            isinstance(checked, float)
            and math.isfinite(checked)
            and 0.0 <= checked <= 2.0
            and checked == value
        )


def test_a_problem_is_told_in_words():
    specs = parameters.parse(TEXT)
    assert parameters.problem(specs["deadline"].check, 1.0) is None
    assert "outside 0.5 to 2 s" in parameters.problem(specs["deadline"].check, 3.0)


def test_infinite_int_is_refused():
    with pytest.raises(InputError):
        ParameterSpec("x", "int", 1, "").check(math.inf)


def test_own_file_is_sound():
    assert parameters.load("fsw_control", "controller.yaml")["deadline"].default == 0.03
