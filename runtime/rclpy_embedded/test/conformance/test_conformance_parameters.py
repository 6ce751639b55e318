"""Parameters of a node: declaring, types, ranges, callbacks, files, events, and setting them from other nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.context import Context
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
)
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.parameter_event_handler import ParameterEventHandler

VALUES = [
    *(True, 7, 2.5, "text", [True, False], [1, 2, 3], [1.5, 2.5], ["a", "b"]),
    [b"a", b"b"],
]
FILE = """
/**:
  ros__parameters:
    gain: 1.0
    everywhere: true
/plant/*:
  ros__parameters:
    gain: 2.0
/plant/pump:
  ros__parameters:
    limits: {upper: 95.0, lower: 60.0}
/other:
  ros__parameters:
    gain: 9.0
"""


@pytest.mark.parametrize("value", VALUES, ids=str)
def test_types(node: Any, value: Any) -> None:
    assert node.declare_parameter("p", value).value == value
    parameter = node.get_parameter("p")
    assert parameter.value == value
    assert parameter.type_ == Parameter.Type.from_parameter_value(value)
    assert node.set_parameters([Parameter("p", value=value)])[0].successful
    other = "text" if value != "text" else 1
    result = node.set_parameters([Parameter("p", value=other)])[0]
    assert not result.successful and "p" in result.reason
    assert node.get_parameter("p").value == value


def test_undeclared(node: Any) -> None:
    assert not node.has_parameter("p")
    with pytest.raises(ParameterNotDeclaredException):
        node.get_parameter("p")
    with pytest.raises(ParameterNotDeclaredException):
        node.set_parameters([Parameter("p", value=1)])
    assert node.get_parameter_or("p", Parameter("p", value=3)).value == 3
    node.declare_parameter("p", 1)
    with pytest.raises(ParameterAlreadyDeclaredException):
        node.declare_parameter("p", 1)
    node.undeclare_parameter("p")
    assert not node.has_parameter("p")


def test_declared_by_type(node: Any) -> None:
    node.declare_parameter("p", Parameter.Type.DOUBLE)
    node.set_parameters([Parameter("p", value=2.0)])
    assert node.get_parameter("p").value == 2.0
    other = rclpy.create_node("typed", context=node.context, parameter_overrides=[Parameter("p", value=1)])
    with pytest.raises(InvalidParameterTypeException):
        other.declare_parameter("p", Parameter.Type.DOUBLE)
    other.destroy_node()


def test_dynamic_typing(node: Any) -> None:
    node.declare_parameter("p", 1, ParameterDescriptor(dynamic_typing=True))
    assert node.set_parameters([Parameter("p", value="text")])[0].successful
    assert node.get_parameter("p").value == "text"


def test_ranges(node: Any) -> None:
    node.declare_parameter(
        "force", 80.0, ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=60.0, to_value=95.0)])
    )
    node.declare_parameter(
        "count", 4, ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=10, step=2)])
    )
    for name, value, good in (
        *(("force", 60.0, True), ("force", 95.0, True), ("force", 95.1, False), ("force", 59.9, False)),
        *(("count", 0, True), ("count", 10, True), ("count", 5, False), ("count", 12, False), ("count", -2, False)),
    ):
        assert node.set_parameters([Parameter(name, value=value)])[0].successful is good, (name, value)
    with pytest.raises(InvalidParameterValueException):
        node.declare_parameter(
            "late", 1.0, ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=2.0, to_value=3.0)])
        )


def test_read_only(node: Any) -> None:
    node.declare_parameter("p", 1, ParameterDescriptor(read_only=True, description="fixed"))
    assert not node.set_parameters([Parameter("p", value=2)])[0].successful
    assert node.describe_parameter("p").description == "fixed"
    with pytest.raises(ParameterImmutableException):
        node.undeclare_parameter("p")


def test_atomic(node: Any) -> None:
    node.declare_parameters("pid", [("p", 1.0), ("i", 2.0)])
    wrong = [Parameter("pid.p", value=5.0), Parameter("pid.i", value="text")]
    assert not node.set_parameters_atomically(wrong).successful
    assert node.get_parameter("pid.p").value == 1.0
    assert [result.successful for result in node.set_parameters(wrong)] == [True, False]
    assert node.get_parameter("pid.p").value == 5.0
    assert set(node.get_parameters_by_prefix("pid")) == {"p", "i"}


def test_callbacks(node: Any) -> None:
    calls: list[tuple[str, Any]] = []
    node.declare_parameters("", [("a", 1), ("b", 1)])

    def before(parameters: list[Any]) -> list[Any]:
        calls.append(("pre", [parameter.name for parameter in parameters]))
        return [*parameters, Parameter("b", value=9)]

    def decide(parameters: list[Any]) -> SetParametersResult:
        calls.append(("on", [parameter.name for parameter in parameters]))
        bad = any(parameter.value == 13 for parameter in parameters)
        return SetParametersResult(successful=not bad, reason="unlucky" if bad else "")

    node.add_pre_set_parameters_callback(before)
    node.add_on_set_parameters_callback(decide)
    node.add_post_set_parameters_callback(lambda parameters: calls.append(("post", len(parameters))))
    assert node.set_parameters_atomically([Parameter("a", value=2)]).successful
    assert calls == [("pre", ["a"]), ("on", ["a", "b"]), ("post", 2)]
    assert node.get_parameter("b").value == 9
    calls.clear()
    result = node.set_parameters_atomically([Parameter("a", value=13)])
    assert (result.successful, result.reason) == (False, "unlucky")
    assert [call[0] for call in calls] == ["pre", "on"]
    assert node.get_parameter("a").value == 2
    node.remove_on_set_parameters_callback(decide)
    assert node.set_parameters_atomically([Parameter("a", value=13)]).successful


@pytest.mark.parametrize(("name", "gain"), [("/plant/pump", 2.0), ("/plant/valve", 2.0), ("/else", 1.0)])
def test_file_with_wildcards(domain_id: int, tmp_path: Path, name: str, gain: float) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text(FILE)
    context = Context()
    context.init(args=["--ros-args", "--params-file", str(path)], domain_id=domain_id)
    namespace, _, base = name.rpartition("/")
    node = rclpy.create_node(base, namespace=namespace, context=context)
    assert node.declare_parameter("gain", 0.0).value == gain
    assert node.declare_parameter("everywhere", False).value is True
    expected = 95.0 if name == "/plant/pump" else 0.0
    assert node.declare_parameter("limits.upper", 0.0).value == expected
    node.destroy_node()
    context.try_shutdown()


def test_overrides_without_declaration(context: Context) -> None:
    node = rclpy.create_node(
        "auto",
        context=context,
        cli_args=["--ros-args", "-p", "gain:=1.5", "-p", "mode:=fast"],
        parameter_overrides=[Parameter("mode", value="slow")],
        automatically_declare_parameters_from_overrides=True,
    )
    assert node.get_parameter("gain").value == 1.5
    assert node.get_parameter("mode").value == "slow"
    node.destroy_node()


def test_from_another_node_and_its_events(context: Context, node: Any, spinner: Any) -> None:
    other = rclpy.create_node("other", namespace="/far", context=context)
    spinner.executor.add_node(other)
    other.declare_parameter("gain", 1.0, ParameterDescriptor(description="How much"))
    seen: list[Any] = []
    events: list[Any] = []
    handler = ParameterEventHandler(node)
    handle = handler.add_parameter_callback("gain", "/far/other", seen.append)
    handler.add_parameter_event_callback(events.append)
    client = AsyncParameterClient(node, "/far/other")
    assert client.wait_for_services(120)
    assert spinner.until(lambda: handler.parameter_event_subscription.get_publisher_count() == 2)

    def call(future: Any) -> Any:
        assert spinner.until(future.done)
        return future.result()

    assert call(client.set_parameters([Parameter("gain", value=2.0)])).results[0].successful
    assert not call(client.set_parameters([Parameter("gain", value="text")])).results[0].successful
    assert not call(client.set_parameters([Parameter("unknown", value=1)])).results[0].successful
    assert call(client.get_parameters(["gain"])).values[0].double_value == 2.0
    assert "gain" in call(client.list_parameters([], 0)).result.names
    assert call(client.describe_parameters(["gain"])).descriptors[0].description == "How much"
    assert call(client.get_parameter_types(["gain"])).types[0] == 3
    assert spinner.until(lambda: [parameter.value.double_value for parameter in seen] == [2.0])
    assert [event.node for event in events if event.changed_parameters] == ["/far/other"]
    handler.remove_parameter_callback(handle)
    with pytest.raises(RuntimeError):
        handler.remove_parameter_callback(handle)
    call(client.set_parameters([Parameter("gain", value=3.0)]))
    assert spinner.until(lambda: len([event for event in events if event.changed_parameters]) == 2)
    assert len(seen) == 1
    handler.destroy()
    other.destroy_node()


def test_file_with_an_invalid_section(tmp_path: Path) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text("/n: {note: 1, ros__parameters: {a: 1, b: {c: [x]}}}\n/m: {b: 2}\n")
    read = parameter_dict_from_yaml_file(str(path), target_nodes=["/n"])
    assert {name: parameter_value_to_python(message.value) for name, message in read.items()} == {"a": 1, "b.c": ["x"]}
    for target_nodes in ([], ["/m"]):
        with pytest.raises(RuntimeError, match=r"^YAML file is not a valid ROS parameter file for node /m$"):
            parameter_dict_from_yaml_file(str(path), target_nodes=target_nodes)
    with pytest.raises(RuntimeError, match=r"parameters for /x,only for nodes: \['/n', '/m'\]"):
        parameter_dict_from_yaml_file(str(path), target_nodes=["/x"])
    with pytest.raises(FileNotFoundError):
        parameter_dict_from_yaml_file(str(tmp_path / "missing.yaml"))
