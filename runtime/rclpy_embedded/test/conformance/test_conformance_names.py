"""Names of nodes, topics and services: rules, expansion, remapping."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
import rclpy.node
from rclpy.context import Context
from rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
)
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from std_msgs.msg import String
from std_srvs.srv import Trigger

RULES = [
    *("-r", "depth:=/fsw/depth", "-r", "/absolute:=relative", "-r", "~/private:=public", "-r", "go:=stop"),
    *("-r", "rover:__node:=lander", "-r", "rover:__ns:=/mars", "-r", "other:depth:=/wrong"),
]


@pytest.fixture
def remapped(domain_id: int) -> Iterator[Any]:
    """A node in /plant whose names are remapped by the command line."""
    context = Context()
    context.init(args=["program", "--ros-args", *RULES], domain_id=domain_id)
    node = rclpy.create_node("pump", namespace="plant", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.mark.parametrize("namespace", [None, "", "/"])
def test_no_namespace(context: Context, namespace: str | None) -> None:
    node = rclpy.create_node("plain", namespace=namespace, context=context)
    assert (node.get_namespace(), node.get_fully_qualified_name()) == ("/", "/plain")
    assert node.get_logger().name == "plain"
    node.destroy_node()


def test_namespace_gets_its_slash(context: Context) -> None:
    node = rclpy.create_node("pump", namespace="plant/hall", context=context)
    assert node.get_fully_qualified_name() == "/plant/hall/pump"
    assert node.get_logger().name == "plant.hall.pump"
    node.destroy_node()


@pytest.mark.parametrize("namespace", ["/plant/", "plant/", "//plant", "/plant//hall", "/1st", "/a-b", "~", "//"])
def test_invalid_namespaces(context: Context, namespace: str) -> None:
    with pytest.raises(InvalidNamespaceException):
        rclpy.create_node("pump", namespace=namespace, context=context)


@pytest.mark.parametrize("name", ["", "1st", "a-b", "a/b", "a b", "ä", "~"])
def test_invalid_node_names(context: Context, name: str) -> None:
    with pytest.raises(InvalidNodeNameException):
        rclpy.create_node(name, context=context)


@pytest.mark.parametrize("name", ["", "1st", "a b", "a//b", "/a/", "a~", "~ab", "{unknown", "a-b"])
def test_invalid_topic_and_service_names(node: Any, name: str) -> None:
    with pytest.raises(InvalidTopicNameException):
        node.create_publisher(String, name, 10)
    with pytest.raises(InvalidServiceNameException):
        node.create_client(Trigger, name)


def test_expansion(context: Context) -> None:
    node = rclpy.create_node("pump", namespace="/plant", context=context)
    names = {"a": "/plant/a", "/a": "/a", "~/a": "/plant/pump/a", "~": "/plant/pump", "{node}/a": "/plant/pump/a"}
    for name, full in names.items():
        assert node.resolve_topic_name(name) == node.resolve_service_name(name) == full
    publisher = node.create_publisher(String, "~/a", 10)
    assert publisher.topic_name == "/plant/pump/a"
    node.destroy_node()


def test_remapping_of_topics_and_services(remapped: Any) -> None:
    assert remapped.resolve_topic_name("depth") == "/fsw/depth"
    assert remapped.resolve_topic_name("/plant/depth") == "/fsw/depth"
    assert remapped.resolve_topic_name("/depth") == "/depth"
    assert remapped.resolve_topic_name("depth", only_expand=True) == "/plant/depth"
    assert remapped.resolve_topic_name("/absolute") == "/plant/relative"
    assert remapped.resolve_topic_name("~/private") == "/plant/public"
    assert remapped.resolve_service_name("go") == "/plant/stop"
    assert remapped.create_subscription(String, "depth", lambda _: None, 10).topic_name == "/fsw/depth"
    assert remapped.create_client(Trigger, "go").service_name == "/plant/stop"


def test_remapping_of_one_node(remapped: Any) -> None:
    rover = rclpy.create_node("rover", context=remapped.context)
    # The rule for the namespace is for a node called rover, which it no longer is.
    assert rover.get_name() == "lander"
    assert remapped.get_fully_qualified_name() == "/plant/pump"
    deaf = rclpy.create_node("deaf", context=remapped.context, use_global_arguments=False)
    assert deaf.resolve_topic_name("depth") == "/depth"
    own = rclpy.create_node("own", context=remapped.context, cli_args=["--ros-args", "-r", "depth:=mine"])
    assert own.resolve_topic_name("depth") == "/mine"
    for node in (rover, deaf, own):
        node.destroy_node()


def test_hidden_names() -> None:
    assert topic_or_service_is_hidden("/fsw/_private/depth")
    assert not topic_or_service_is_hidden("/fsw/not_private")


class BusyNode(rclpy.node.Node):
    """Has attributes and methods of its own, with names a user may well think of."""

    def __init__(self, context: Context) -> None:
        self._rules = self._session = self._topic = self._handle = self._waitables = self._name = 1
        super().__init__("busy", context=context)
        self._executor = self._graph = self._profile = self._local_node = self._alive = self._rosout = 1

    def destroy(self) -> None:
        raise AssertionError("nobody asked for this")

    _add = _check = _destroy = _info = _infos = _full_name = _remapped = _resolve = _destroy_all = destroy
    _publish_event = _all_endpoints = _topics_of = _namespace = _logger_name = destroy


def test_a_node_may_have_members_of_its_own(context: Context, spinner: Any) -> None:
    node = BusyNode(context)
    spinner.executor.add_node(node)
    got: list[Any] = []
    publisher = node.create_publisher(String, "chatter", 10)
    node.create_subscription(String, "chatter", got.append, 10)
    node.create_service(Trigger, "go", lambda request, response: response)
    node.create_timer(0.01, lambda: publisher.publish(String(data=node.get_fully_qualified_name())))
    assert spinner.until(lambda: got)
    assert spinner.until(lambda: node.count_publishers("chatter") == 1)
    assert len(node.get_publishers_info_by_topic("chatter")) == 1
    node.declare_parameter("depth", 1.0)
    node.get_logger().info("busy")
    assert node._executor == node._topic == 1
    node.destroy_node()
