"""Parameters of a YAML file on a real node: declared, described, refused, changed."""

import math
from typing import Annotated, Literal

import pytest
import rclpy
from pydantic import model_validator
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from fsw_control import parameters_ros
from fsw_control.parameters import AT_START, NodeParameters, validate
from fsw_control.parameters_ros import ParameterValues
from fsw_control.schema.errors import InputError
from fsw_control.schema.models import Many, Whole
from fsw_control.schema.ranges import Range


class Example(NodeParameters):
    """Parameters of every type."""

    wait: Annotated[float, Range(0.5, 2.0, "s")] = 1.0
    """Wait so long."""
    count: Annotated[Whole, Range(0, 9, "")] = 3
    """How many."""
    kind: Literal["a", "b"] = "a"
    """Which."""
    fixed: Annotated[bool, AT_START] = True
    """Whether."""
    names: Many[str] = ()
    """Who."""
    owners: Annotated[Many[str], AT_START] = ()
    """Whose."""
    weights: Many[Annotated[float, Range(0.0, 10.0, "")]] = (1.0, 2.0)
    """How much."""

    @model_validator(mode="after")
    def _consistent(self):
        if self.wait * self.count > 12.0:
            raise ValueError("wait and count are too much together")
        return self


@pytest.fixture
def start(domain_id):
    nodes = []

    def make(*args):
        rclpy.init(args=["test", *args], domain_id=domain_id)
        nodes.append(rclpy.create_node("parameters_test"))
        return nodes[-1], ParameterValues(nodes[-1], Example)

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def test_defaults_and_descriptors(start):
    node, values = start()
    assert values.values == {
        "wait": 1.0,
        "count": 3,
        "kind": "a",
        "fixed": True,
        "names": [],
        "owners": [],
        "weights": [1.0, 2.0],
    }
    descriptor = node.describe_parameter("wait")
    assert descriptor.description.endswith(" [s]")
    assert descriptor.floating_point_range[0].to_value == 2.0
    assert node.describe_parameter("kind").description.endswith("of a, b)")
    assert node.describe_parameter("count").integer_range[0].to_value == 9
    assert node.describe_parameter("fixed").read_only
    everything = node.get_parameters(list(values.values))  # raises if one has no value
    assert [
        list(parameter.value) for parameter in everything if parameter.name in ("names", "owners")
    ] == [[], []]


def test_values_from_the_command_line(start):
    _, values = start(
        "--ros-args",
        "-p",
        "wait:=1.5",
        "-p",
        "names:=[me, you]",
        "-p",
        "kind:=b",
        "-p",
        "owners:=[us]",
    )
    assert (values["wait"], values["names"], values["kind"]) == (1.5, ["me", "you"], "b")
    assert values["owners"] == ["us"]


@pytest.mark.parametrize(
    "override",
    [
        "wait:=9.0",
        "wait:=.nan",
        "count:=10",
        "kind:=c",
        "weights:=[1.0, 11.0]",
        "wait:=soon",
        "names:=3",
    ],
)
def test_bad_values_at_start_are_refused(start, override):
    with pytest.raises(Exception, match=override.partition(":")[0]):
        start("--ros-args", "-p", override)


def test_values_at_start_are_checked_together(start):
    _, values = start("--ros-args", "-p", "wait:=0.5", "-p", "count:=9")  # 9 alone would not fit
    assert (values["wait"], values["count"]) == (0.5, 9)


def test_contradiction_at_start_is_refused(start):
    with pytest.raises(InputError, match="wait and count"):
        start("--ros-args", "-p", "wait:=2.0", "-p", "count:=9")


def test_contradiction_at_runtime_is_refused(start):
    node, values = start()
    before = values.values
    (result,) = node.set_parameters([Parameter("count", value=9)])
    assert result.successful
    (result,) = node.set_parameters([Parameter("wait", value=2.0)])
    assert not result.successful and "wait and count" in result.reason
    assert values.values == before | {"count": 9}
    assert node.get_parameter("wait").value == 1.0


def test_changes_are_checked_together_and_reported_once(start):
    node, values = start()
    accepted = []
    values.on_change(accepted.append)
    values.add_check(
        lambda values: "too much" if values["wait"] * values["count"] > 10.0 else None
    )
    before = values.values
    result = node.set_parameters_atomically(
        [Parameter("wait", value=2.0), Parameter("count", value=6)]
    )
    assert not result.successful and result.reason == "too much"
    assert values.values == before and not accepted
    result = node.set_parameters_atomically(
        [Parameter("wait", value=2.0), Parameter("count", value=4)]
    )
    assert result.successful
    assert (values["wait"], values["count"]) == (2.0, 4)
    assert accepted == [values.values]
    assert before["wait"] == 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("wait", math.nan),
        ("kind", "c"),
        ("weights", [math.inf]),
        ("wait", 0.1),
        ("fixed", False),
        ("owners", ["me"]),
    ],
)
def test_bad_changes_leave_the_value(start, name, value):
    node, values = start()
    before = dict(values.values)
    (result,) = node.set_parameters([Parameter(name, value=value)])
    assert not result.successful and result.reason
    assert values.values == before


def test_a_change_is_validated_once(start, monkeypatch):
    node, values = start()
    calls = []

    def counting(model, values):
        calls.append(values["wait"])
        return validate(model, values)

    monkeypatch.setattr(parameters_ros, "validate", counting)
    assert node.set_parameters([Parameter("wait", value=1.5)])[0].successful
    assert calls == [1.5] and values["wait"] == 1.5


def test_a_change_refused_by_another_callback_has_no_effect_on_the_next_one(start):
    """Another callback may refuse a change that has been checked here, whatever their order."""
    node, values = start()
    seen = []
    values.on_change(seen.append)

    def refuse(parameters):
        return SetParametersResult(
            successful=all(parameter.name != "wait" for parameter in parameters)
        )

    node._on_set_parameters_callbacks.append(refuse)  # rclpy's own method puts it first
    node.declare_parameter("foreign", 1)
    assert not node.set_parameters([Parameter("wait", value=1.5)])[0].successful
    assert node.set_parameters([Parameter("foreign", value=2)])[0].successful
    assert values["wait"] == 1.0 and seen == []
    assert node.set_parameters([Parameter("count", value=2)])[0].successful
    assert (values["wait"], values["count"]) == (1.0, 2) and len(seen) == 1
