"""Models of parameters: how they are described, what is refused, what is made of them."""

import math
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import model_validator

from fsw_control.common_parameters import ControllerParameters, hosted
from fsw_control.parameters import AT_START, NodeParameters, defaults, describe, problem, validate
from fsw_control.schema.extensions import all_loaded
from fsw_control.schema.models import InputError, Many, Model, Whole
from fsw_control.schema.ranges import Range


class Loops(Model):
    """A group."""

    count: Whole = 3
    """How many."""
    gain: Annotated[float, Range(0.0, 2.0, "kN")] = 1.0
    """How
    strong."""

    @model_validator(mode="after")
    def _consistent(self):
        if self.count * self.gain > 10.0:
            raise ValueError("are too strong together")
        return self


class Example(NodeParameters):
    """Parameters of every type."""

    deadline: Annotated[float, Range(0.5, 2.0, "s")] = 1.0
    """Wait so long."""
    loops: Loops = Loops()
    kind: Annotated[Literal["a", "b"], AT_START] = "a"
    """Which."""
    names: Many[str] = ()
    """Who."""
    weights: Many[Annotated[float, Range(0.0, 10.0, "")]] = (1.0, 2.5)
    """How much of each."""
    enabled: bool = False
    """Whether."""
    rate: float = 1.0
    """A number without a range."""


ANYTHING = st.one_of(
    st.floats(), st.integers(), st.text(), st.booleans(), st.none(), st.lists(st.floats())
)
#: of all nodes
NUMBERS = [
    pytest.param(model, spec, id=f"{name}.{spec.name}")
    for name, model in all_loaded("fsw.schemas").items()
    if issubclass(model, NodeParameters)
    for spec in describe(model).values()
    if spec.type in ("double", "int")
]


def test_describes_every_type():
    specs = describe(Example)
    assert defaults(Example) == {
        "deadline": 1.0,
        "loops.count": 3,
        "loops.gain": 1.0,
        "kind": "a",
        "names": [],
        "weights": [1.0, 2.5],
        "enabled": False,
        "rate": 1.0,
    }
    types = ["double", "int", "double", "string", "string_array", "double_array", "bool", "double"]
    assert [spec.type for spec in specs.values()] == types
    assert specs["loops.gain"].description == "How strong"
    assert (specs["loops.gain"].range, specs["loops.gain"].unit) == ((0.0, 2.0), "kN")
    assert specs["weights"].range == (0.0, 10.0)
    assert specs["kind"].options == ("a", "b")
    assert specs["kind"].read_only and not specs["deadline"].read_only


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"deadline": 3.0}, ("deadline", "3", "0.5 to 2 s")),
        ({"deadline": math.nan}, ("deadline", "nan")),
        ({"deadline": True}, ("deadline", "True")),
        ({"deadline": None}, ("deadline",)),
        ({"rate": math.inf}, ("rate", "inf")),
        ({"rate": 10**400}, ("rate",)),
        ({"rate": "1.0"}, ("rate", "1.0")),
        ({"loops.count": 1.5}, ("loops.count", "1.5")),
        ({"loops.count": 6, "loops.gain": 2.0}, ("loops",)),
        ({"kind": "c"}, ("kind", "c", "'a' or 'b'")),
        ({"kind": 1}, ("kind", "1")),
        ({"names": "me"}, ("names", "me")),
        ({"names": ["me", 1]}, ("names[1]", "1")),
        ({"weights": [1.0, 11.0]}, ("weights[1]", "11", "0 to 10")),
        ({"weights": [math.nan]}, ("weights[0]", "nan")),
        ({"enabled": 1}, ("enabled", "1")),
        ({"loops": {"count": 1}}, ("loops",)),
        ({"loops.cuont": 1}, ("loops.cuont", "loops.count")),
    ],
)
def test_refusal_names_parameter_value_and_limits(values, named):
    with pytest.raises(InputError) as caught:
        validate(Example, values)
    assert all(word in str(caught.value) for word in named) and "\n" not in str(caught.value)


def test_values_are_completed_and_converted():
    values = validate(Example, {"deadline": 2, "loops.count": 4.0, "names": ("me",)})
    assert values == defaults(Example) | {"deadline": 2.0, "loops.count": 4, "names": ["me"]}
    assert isinstance(values["deadline"], float) and isinstance(values["loops.count"], int)


@given(value=ANYTHING)
def test_accepted_number_is_finite_and_in_range(value):
    good = isinstance(value, int | float) and not isinstance(value, bool) and 0.5 <= value <= 2.0
    reason = problem(lambda values: validate(Example, values), {"deadline": value})
    assert (reason is None) == good


@given(value=ANYTHING)
def test_number_without_range_is_finite(value):
    try:
        rate = validate(Example, {"rate": value})["rate"]
    except InputError:
        return
    assert isinstance(rate, float) and math.isfinite(rate) and not isinstance(value, bool | str)


@pytest.mark.parametrize(("model", "spec"), NUMBERS)
def test_every_number_of_every_node_is_checked(model, spec):
    wrong = [math.nan, math.inf, -math.inf, "1", True, None, [1.0]]
    if spec.range:
        wrong += [spec.range[0] - 1e-3, spec.range[1] + 1.0]
    for value in wrong:
        with pytest.raises(InputError, match=spec.name):
            validate(model, {spec.name: value})


def test_controllers_node_has_its_own_and_the_common_parameters():
    assert set(describe(hosted(Example))) == {*describe(Example), *describe(ControllerParameters)}
    assert hosted(None) is ControllerParameters and describe(None) == {}
    with pytest.raises(InputError):
        validate(None, {"deadline": 1.0})
