"""Parameters of another node, over the middleware."""

from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor, ParameterEvent
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient


@pytest.fixture
def client(node: Node, spinner: Any) -> AsyncParameterClient:
    node.declare_parameters("", [("gain", 1.5), ("a.b", [1, 2]), ("mode", "auto")])
    limits = ParameterDescriptor(description="steps", integer_range=[IntegerRange(from_value=0, to_value=5)])
    node.declare_parameter("steps", 1, limits)
    node.declare_parameter("loose", 1, ParameterDescriptor(dynamic_typing=True))
    client = AsyncParameterClient(node, node.get_name())
    assert spinner.until(client.services_are_ready)
    assert client.wait_for_services(timeout_sec=120.0)
    return client


def result(spinner: Any, future: Any) -> Any:
    assert spinner.until(future.done)
    return future.result()


def test_reading(client: AsyncParameterClient, spinner: Any) -> None:
    seen = []
    values = result(spinner, client.get_parameters(["mode", "a.b"], callback=seen.append)).values
    assert [parameter_value_to_python(value) for value in values] == ["auto", [1, 2]]
    assert len(seen) == 1
    assert result(spinner, client.get_parameters(["mode", "nowhere"])).values == []
    assert list(result(spinner, client.get_parameter_types(["gain", "mode"])).types) == [3, 4]
    (descriptor,) = result(spinner, client.describe_parameters(["steps"])).descriptors
    assert (descriptor.name, descriptor.description, descriptor.integer_range[0].to_value) == ("steps", "steps", 5)
    listed = result(spinner, client.list_parameters(["a"], 1)).result
    assert (listed.names, listed.prefixes) == (["a.b"], ["a"])
    assert "gain" in result(spinner, client.list_parameters()).result.names


def test_setting_is_answered_and_announced(client: AsyncParameterClient, node: Node, spinner: Any) -> None:
    events: list[ParameterEvent] = []
    subscription = client.on_parameter_event(events.append)
    assert spinner.until(lambda: node.count_publishers("/parameter_events") > 0)
    wanted = [Parameter("gain", value=2.5), Parameter("steps", value=9).to_parameter_msg()]
    answers = result(spinner, client.set_parameters(wanted)).results
    assert [answer.successful for answer in answers] == [True, False]
    assert "out of range" in answers[1].reason
    assert not result(spinner, client.set_parameters_atomically(wanted)).result.successful
    assert spinner.until(lambda: any(p.name == "gain" for event in events for p in event.changed_parameters))
    assert events[-1].node == "/test_node"
    assert result(spinner, client.delete_parameters(["loose"])).results[0].successful
    assert not node.has_parameter("loose")
    node.destroy_subscription(subscription)


def test_loading_a_file(client: AsyncParameterClient, node: Node, spinner: Any, tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("/**: {ros__parameters: {gain: 7.5}}\n/test_node: {ros__parameters: {a: {b: [3]}}}\n")
    answers = result(spinner, client.load_parameter_file(str(path), use_wildcard=True)).results
    assert [answer.successful for answer in answers] == [True, True]
    assert (node.get_parameter("gain").value, list(node.get_parameter("a.b").value)) == (7.5, [3])
    assert result(spinner, client.load_parameter_file_atomically(str(path))).result.successful


def test_waiting_for_nobody_ends(node: Node) -> None:
    assert AsyncParameterClient(node, "/nobody").wait_for_services(timeout_sec=0.1) is False
