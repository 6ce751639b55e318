"""Parameters of a YAML file on a real node: declared, described, refused, changed."""

import math

import pytest
import rclpy
from rclpy.parameter import Parameter

from fsw_control import parameters
from fsw_control.parameters_ros import ParameterValues

TEXT = """
wait:
  type: double
  default_value: 1.0
  description: "Wait so long"
  unit: "s"
  range: [0.5, 2.0]
count:
  type: int
  default_value: 3
  description: "How many"
  range: [0, 9]
kind:
  type: string
  default_value: a
  description: "Which"
  options: [a, b]
fixed:
  type: bool
  default_value: true
  description: "Whether"
  read_only: true
names:
  type: string_array
  default_value: []
  description: "Who"
owners:
  type: string_array
  default_value: []
  description: "Whose"
  read_only: true
weights:
  type: double_array
  default_value: [1.0, 2.0]
  description: "How much"
  range: [0.0, 10.0]
"""


@pytest.fixture
def start(domain_id):
    nodes = []

    def make(*args):
        rclpy.init(args=["test", *args], domain_id=domain_id)
        nodes.append(rclpy.create_node("parameters_test"))
        return nodes[-1], ParameterValues(nodes[-1], parameters.parse(TEXT))

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
    assert [list(one.value) for one in everything if one.name in ("names", "owners")] == [[], []]


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


def test_changes_are_checked_as_a_whole_and_told_once(start):
    node, values = start()
    told = []
    values.on_change(told.append)
    values.add_check(
        lambda wanted: "too much" if wanted["wait"] * wanted["count"] > 10.0 else None
    )
    before = values.values
    result = node.set_parameters_atomically(
        [Parameter("wait", value=2.0), Parameter("count", value=8)]
    )
    assert not result.successful and result.reason == "too much"
    assert values.values == before and not told
    result = node.set_parameters_atomically(
        [Parameter("wait", value=2.0), Parameter("count", value=4)]
    )
    assert result.successful
    assert (values["wait"], values["count"]) == (2.0, 4)
    assert told == [values.values]
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
