"""Publishers and subscriptions."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle, InvalidTopicNameException
from rclpy.qos import (
    QoSCompatibility,
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSLivelinessPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
    qos_check_compatible,
    qos_profile_best_available,
    qos_profile_sensor_data,
)
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import Empty, String

PROFILES = [
    QoSProfile(depth=10, reliability=reliability, durability=durability)
    for reliability, durability in itertools.product(
        (QoSReliabilityPolicy.RELIABLE, QoSReliabilityPolicy.BEST_EFFORT),
        (QoSDurabilityPolicy.VOLATILE, QoSDurabilityPolicy.TRANSIENT_LOCAL),
    )
]


def test_message_and_info(node: Any, spinner: Any) -> None:
    got: list[Any] = []
    node.create_subscription(String, "chat", lambda message, info: got.append((message, info)), 10)
    publisher = node.create_publisher(String, "chat", 10)
    publisher.publish(String(data="hello"))
    assert spinner.until(lambda: got)
    message, info = got[0]
    assert message == String(data="hello")
    assert 0 < info["source_timestamp"] <= info["received_timestamp"]
    assert info["publication_sequence_number"] is None


@pytest.mark.parametrize("offered", PROFILES)
@pytest.mark.parametrize("requested", PROFILES)
def test_qos_pairs(node: Any, spinner: Any, offered: QoSProfile, requested: QoSProfile) -> None:
    got: list[str] = []
    publisher = node.create_publisher(String, "pair", offered)
    subscription = node.create_subscription(String, "pair", lambda message: got.append(message.data), requested)
    compatible = qos_check_compatible(offered, requested)[0] != QoSCompatibility.ERROR
    if compatible:
        assert spinner.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(String(data="x"))
    if compatible:
        assert spinner.until(lambda: got == ["x"])
    else:
        spinner.rest()
        assert got == []
    assert publisher.get_subscription_count() == subscription.get_publisher_count() == int(compatible)


def test_late_joiner_gets_transient_local(node: Any, spinner: Any) -> None:
    latched = QoSProfile(depth=2, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    publisher = node.create_publisher(String, "latched", latched)
    for text in "abc":
        publisher.publish(String(data=text))
    got: list[str] = []
    node.create_subscription(String, "latched", lambda message: got.append(message.data), latched)
    assert spinner.until(lambda: len(got) == 2)
    assert got == ["b", "c"]


def test_late_joiner_gets_nothing_volatile(node: Any, spinner: Any) -> None:
    node.create_publisher(String, "volatile", 10).publish(String(data="gone"))
    got: list[Any] = []
    node.create_subscription(String, "volatile", got.append, 10)
    spinner.rest()
    assert got == []


def test_history_depth_limits_what_waits(node: Any, spinner: Any) -> None:
    got: list[str] = []
    node.create_subscription(String, "deep", lambda message: got.append(message.data), 3)
    publisher = node.create_publisher(String, "deep", 10)
    for number in range(7):
        publisher.publish(String(data=str(number)))
    assert spinner.until(lambda: len(got) == 3)
    spinner.rest()
    assert got == ["4", "5", "6"]


def test_keep_all(node: Any, spinner: Any) -> None:
    everything = QoSProfile(history=QoSHistoryPolicy.KEEP_ALL)
    got: list[str] = []
    node.create_subscription(String, "all", lambda message: got.append(message.data), everything)
    publisher = node.create_publisher(String, "all", everything)
    for number in range(100):
        publisher.publish(String(data=str(number)))
    assert spinner.until(lambda: len(got) == 100)
    assert got == [str(number) for number in range(100)]


def test_best_available_subscription_adapts(node: Any, spinner: Any) -> None:
    node.create_publisher(String, "adapts", qos_profile_sensor_data)
    assert spinner.until(lambda: node.count_publishers("adapts") == 1)
    subscription = node.create_subscription(String, "adapts", lambda _: None, qos_profile_best_available)
    assert subscription.qos_profile.reliability == QoSReliabilityPolicy.BEST_AVAILABLE
    assert spinner.until(lambda: node.count_subscribers("adapts") == subscription.get_publisher_count() == 1)
    (info,) = node.get_subscriptions_info_by_topic("adapts")
    assert info.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT


def test_best_available_subscription_is_strict_when_alone(node: Any, spinner: Any) -> None:
    node.create_subscription(String, "alone", lambda _: None, qos_profile_best_available)
    assert spinner.until(lambda: node.count_subscribers("alone") == 1)
    (info,) = node.get_subscriptions_info_by_topic("alone")
    assert info.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
    assert info.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    assert info.qos_profile.liveliness == QoSLivelinessPolicy.MANUAL_BY_TOPIC


def test_raw_both_ways(node: Any, spinner: Any) -> None:
    got: list[bytes] = []
    node.create_subscription(String, "raw", got.append, 10, raw=True)
    publisher = node.create_publisher(String, "raw", 10)
    publisher.publish(serialize_message(String(data="abcd")))
    assert spinner.until(lambda: got)
    assert isinstance(got[0], bytes)
    assert deserialize_message(got[0], String) == String(data="abcd")


def test_empty_message(node: Any, spinner: Any) -> None:
    got: list[Any] = []
    node.create_subscription(Empty, "empty", got.append, 10)
    node.create_publisher(Empty, "empty", 10).publish(Empty())
    assert spinner.until(lambda: got == [Empty()])


def test_large_message(node: Any, spinner: Any) -> None:
    got: list[Any] = []
    node.create_subscription(String, "large", got.append, 1)
    text = "ab" * 1_000_000
    node.create_publisher(String, "large", 1).publish(String(data=text))
    assert spinner.until(lambda: got)
    assert got[0].data == text


def test_wrong_type(node: Any) -> None:
    publisher = node.create_publisher(String, "typed", 10)
    with pytest.raises(TypeError, match="Expected"):
        publisher.publish(Empty())
    with pytest.raises(TypeError):
        publisher.publish("text")


def test_not_a_message_class(node: Any) -> None:
    from std_srvs.srv import Trigger

    with pytest.raises(RuntimeError, match="might be a service"):
        node.create_publisher(Trigger, "typed", 10)
    with pytest.raises(AttributeError, match="ROS 1"):
        node.create_subscription(int, "typed", lambda _: None, 10)


def test_after_destruction(node: Any, wait_until: Any) -> None:
    publisher = node.create_publisher(String, "gone", 10)
    subscription = node.create_subscription(String, "gone", lambda _: None, 10)
    assert node.destroy_publisher(publisher)
    assert not node.destroy_publisher(publisher)
    assert node.destroy_subscription(subscription)
    for use in (
        lambda: publisher.publish(String()),
        publisher.get_subscription_count,
        lambda: publisher.topic_name,
        subscription.get_publisher_count,
        lambda: subscription.topic_name,
    ):
        with pytest.raises(InvalidHandle):
            use()
    assert wait_until(lambda: node.count_publishers("gone") == node.count_subscribers("gone") == 0)


@pytest.mark.parametrize("name", ["", "1chat", "chat chat", "chat/", "~chat", "a//b", "{unknown}"])
def test_invalid_names(node: Any, name: str) -> None:
    with pytest.raises((InvalidTopicNameException, ValueError)):
        node.create_publisher(String, name, 10)


def test_names(node: Any) -> None:
    publisher = node.create_publisher(String, "~/status", 10)
    assert publisher.topic_name == "/test_node/status"
    assert publisher.topic == "~/status"
    assert node.resolve_topic_name("a/b") == "/a/b"


@pytest.mark.parametrize("depth", [-1, "ten", None])
def test_bad_depth(node: Any, depth: Any) -> None:
    with pytest.raises((TypeError, ValueError)):
        node.create_publisher(String, "chat", depth)


def test_callback_signature(node: Any) -> None:
    with pytest.raises(RuntimeError, match="one argument"):
        node.create_subscription(String, "chat", lambda: None, 10)


def test_wait_for_all_acked(node: Any, spinner: Any) -> None:
    publisher = node.create_publisher(String, "acked", 10)
    node.create_subscription(String, "acked", lambda _: None, 10)
    publisher.publish(String(data="x"))
    assert publisher.wait_for_all_acked(Duration(seconds=120))
    assert publisher.wait_for_all_acked()
    assert node.create_publisher(String, "unacked", qos_profile_sensor_data).wait_for_all_acked(Duration(seconds=0))


def test_wait_for_message(context: Any, node: Any, wait_until: Any) -> None:
    latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    assert wait_for_message(String, node, "once", qos_profile=latched, time_to_wait=0.05) == (False, None)
    node.create_publisher(String, "once", latched).publish(String(data="now"))
    found, message = wait_for_message(String, node, "once", qos_profile=latched, time_to_wait=120)
    assert found and message.data == "now"
    assert wait_until(lambda: node.count_subscribers("once") == 0)


def test_many_nodes_in_one_process(context: Any, spinner: Any) -> None:
    got: list[int] = []
    nodes = [rclpy.create_node(f"node_{number}", context=context) for number in range(50)]
    for number, other in enumerate(nodes):
        spinner.executor.add_node(other)
        other.create_subscription(String, "to_all", lambda _, number=number: got.append(number), 10)
    publisher = nodes[0].create_publisher(String, "to_all", 10)
    assert spinner.until(lambda: publisher.get_subscription_count() == 50)
    publisher.publish(String(data="x"))
    assert spinner.until(lambda: len(got) == 50)
    assert sorted(got) == list(range(50))
    assert spinner.until(lambda: len(nodes[0].get_node_names()) == 51)
