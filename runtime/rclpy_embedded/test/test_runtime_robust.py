"""Malformed data from the network: counted, logged once, dropped."""

from __future__ import annotations

import random
import socket
import tracemalloc
from collections.abc import Iterator
from typing import Any

import pytest
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from rcl_interfaces.msg import ParameterEvent
from rclpy.impl import faults
from rclpy.impl.dds import qos_to_dds, raw_type
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import SetBool

from rosidl_embedded.typesupport import get_message

BAD_STRINGS = {
    "truncated length": bytes.fromhex("00010000 0500"),
    "truncated text": bytes.fromhex("00010000 05000000 6162"),
    "huge length": bytes.fromhex("00010000 ffffffff 61626300"),
    "zero length": bytes.fromhex("00010000 00000000 00000000 00000000"),
    "invalid UTF-8": bytes.fromhex("00010000 04000000 fffe8000"),
    "too long": bytes.fromhex("00010000 02000000 61000000") + bytes(64),
    "XCDR2": bytes.fromhex("00070000 02000000 6100"),
    "parameter list": bytes.fromhex("00030000 02000000 6100"),
    "unknown encapsulation": bytes.fromhex("00010000 02000000 6100").replace(b"\0\1\0\0", b"\x7f\x7f\0\0", 1),
}


class Attacker:
    """A participant of its own that sends whatever bytes it likes."""

    def __init__(self, domain_id: int) -> None:
        self.participant = DomainParticipant(domain_id)
        self.kept: list[Any] = []

    def writer(self, topic: str, dds_type: str, profile: QoSProfile | None = None, user_data: str = "") -> Any:
        sample = raw_type(dds_type)
        qos = qos_to_dds(profile or QoSProfile(depth=100), user_data, writer=True)
        writer = DataWriter(self.participant, Topic(self.participant, topic, sample), qos)
        self.kept.append(writer)
        return lambda data: writer.write(sample(data))


@pytest.fixture
def attacker(domain_id: int, context: Any) -> Iterator[Attacker]:
    faults.counts.clear()
    yield Attacker(domain_id)


@pytest.mark.parametrize("name", sorted(BAD_STRINGS))
def test_bad_message(
    node: Any, spinner: Any, attacker: Attacker, wait_until: Any, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    got: list[str] = []
    subscription = node.create_subscription(String, "chat", lambda message: got.append(message.data), 100)
    send = attacker.writer("rt/chat", "std_msgs::msg::dds_::String_")
    assert wait_until(lambda: subscription.get_publisher_count() == 1)
    for _ in range(3):
        send(BAD_STRINGS[name])
    send(serialize_message(String(data="good")))
    assert spinner.until(lambda: got)
    assert got == ["good"]
    # An encapsulation that Cyclone DDS itself does not know never gets as far as us.
    if name not in ("XCDR2", "parameter list", "unknown encapsulation"):
        assert faults.counts["/chat"] == 3
        assert capfd.readouterr().err.count("dropped malformed message on '/chat'") == 1


def test_fuzzed_messages(node: Any, spinner: Any, attacker: Attacker, wait_until: Any) -> None:
    got: list[Any] = []
    subscription = node.create_subscription(ParameterEvent, "events", got.append, 1000)
    send = attacker.writer("rt/events", "rcl_interfaces::msg::dds_::ParameterEvent_", QoSProfile(depth=1000))
    assert wait_until(lambda: subscription.get_publisher_count() == 1)
    generator = random.Random(1)
    valid = serialize_message(ParameterEvent(node="/some/node"))
    for _ in range(300):
        data = bytearray(valid)
        for _ in range(generator.randint(1, 6)):
            data[generator.randrange(4, len(data))] = generator.randrange(256)
        send(bytes(data[: generator.randint(5, len(data))]))
    end = ParameterEvent(node="/the/end")
    send(serialize_message(end))
    assert spinner.until(lambda: got and got[-1] == end)
    assert faults.counts["/events"] > 50


def test_bad_requests_and_replies(node: Any, spinner: Any, attacker: Attacker, wait_until: Any) -> None:
    def invert(request: Any, response: Any) -> Any:
        response.success = not request.data
        return response

    node.create_service(SetBool, "invert", invert)
    client = node.create_client(SetBool, "invert")
    assert client.wait_for_service(120)
    ask = attacker.writer("rq/invertRequest", "std_srvs::srv::dds_::SetBool_Request_", user_data="clientid=nonsense;")
    reply = attacker.writer("rr/invertReply", "std_srvs::srv::dds_::SetBool_Response_", user_data="serviceid=;")
    assert wait_until(lambda: len(client.handle.get_matched_publications()) == 2)
    guid = client._guid.to_bytes(8, "little")
    for body in (b"\1", bytes(8), bytes(16), bytes(40)):
        ask(b"\0\1\0\0" + body)
        reply(b"\0\1\0\0" + body)
        reply(b"\0\1\0\0" + guid + body)
    # A well-formed answer to a call that was never made.
    reply(b"\0\1\0\0" + guid + (99).to_bytes(8, "little") + b"\1\0\0\0\1\0\0\0\0")
    future = client.call_async(SetBool.Request(data=False))
    assert spinner.until(future.done)
    assert future.result().success
    assert faults.counts["/invert"] > 3


def test_bad_discovery_info(node: Any, attacker: Attacker, wait_until: Any) -> None:
    latched = QoSProfile(depth=100, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    send = attacker.writer(
        "ros_discovery_info", "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_", latched, "typehash=RIHS01_zz;"
    )
    for data in (bytes(1), bytes(15), bytes(16) + b"\xff\xff\xff\xff", bytes(20) + b"\xff" * 20):
        send(b"\0\1\0\0" + data)
    assert wait_until(lambda: node.get_node_names() == ["test_node"] and faults.counts["ros_discovery_info"] >= 3)


@pytest.mark.parametrize(
    "user_data", [b"typehash=RIHS01_zz;", b"\xff\xfe=\x00;;==;", b"typehash=", b"serviceid=;clientid=;", b""]
)
def test_bad_user_data(node: Any, attacker: Attacker, wait_until: Any, user_data: bytes) -> None:
    topic = Topic(attacker.participant, "rt/odd", raw_type("not_a_ros_type"))
    writer = DataWriter(attacker.participant, topic, Qos(Policy.Userdata(user_data)))
    assert wait_until(lambda: node.count_publishers("/odd") == 1)
    (info,) = node.get_publishers_info_by_topic("/odd")
    assert str(info.topic_type_hash) == "INVALID"
    assert info.topic_type == "not_a_ros_type"
    assert info.node_name == "_NODE_NAME_UNKNOWN_"
    assert ("/odd", ["not_a_ros_type"]) in node.get_topic_names_and_types()
    del writer


def test_wrong_type_name_does_not_match(node: Any, spinner: Any, attacker: Attacker, wait_until: Any) -> None:
    got: list[Any] = []
    subscription = node.create_subscription(String, "chat", got.append, 10)
    send = attacker.writer("rt/chat", "std_msgs::msg::dds_::Int32_")
    assert wait_until(lambda: node.count_publishers("chat") == 1)
    send(serialize_message(String(data="x")))
    spinner.rest()
    assert got == [] and subscription.get_publisher_count() == 0


def test_wrong_type_hash_is_only_shown(node: Any, spinner: Any, attacker: Attacker, wait_until: Any) -> None:
    got: list[Any] = []
    subscription = node.create_subscription(String, "chat", got.append, 10)
    wrong = "RIHS01_" + "0" * 64
    send = attacker.writer("rt/chat", "std_msgs::msg::dds_::String_", user_data=f"typehash={wrong};")
    assert wait_until(lambda: subscription.get_publisher_count() == 1)
    send(serialize_message(String(data="x")))
    assert spinner.until(lambda: got)
    assert [str(info.topic_type_hash) for info in node.get_publishers_info_by_topic("chat")] == [wrong]


def test_huge_counts_allocate_nothing(node: Any, spinner: Any, attacker: Attacker, wait_until: Any) -> None:
    got: list[Any] = []
    subscription = node.create_subscription(PointCloud2, "points", got.append, 100)
    send = attacker.writer("rt/points", "sensor_msgs::msg::dds_::PointCloud2_", QoSProfile(depth=100))
    assert wait_until(lambda: subscription.get_publisher_count() == 1)
    good = serialize_message(PointCloud2(data=b"abc"))
    tracemalloc.start()
    try:
        # Every aligned word in turn says that four billion elements follow.
        for at in range(4, len(good) - 3, 4):
            send(good[:at] + b"\xff\xff\xff\xff" + good[at + 4 :])
        send(serialize_message(PointCloud2(height=7)))
        assert spinner.until(lambda: got and got[-1].height == 7)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()
    assert faults.counts["/points"] > 3


def test_fuzzed_discovery_info(node: Any, attacker: Attacker, wait_until: Any) -> None:
    info = get_message("rmw_dds_common/msg/ParticipantEntitiesInfo")
    entities = get_message("rmw_dds_common/msg/NodeEntitiesInfo")
    gid = get_message("rmw_dds_common/msg/Gid")
    message = info(
        gid=gid(data=list(attacker.participant.guid.bytes)),
        node_entities_info_seq=[entities(node_namespace="/far", node_name="other", reader_gid_seq=[gid()] * 3)] * 2,
    )
    latched = QoSProfile(depth=1000, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    send = attacker.writer("ros_discovery_info", "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_", latched)
    valid, generator = serialize_message(message), random.Random(2)
    for _ in range(300):
        data = bytearray(valid)
        for _ in range(generator.randint(1, 8)):
            data[generator.randrange(4, len(data))] = generator.randrange(256)
        send(bytes(data[: generator.randint(5, len(data))]))
        node.get_node_names_and_namespaces()
    send(valid)
    assert wait_until(lambda: ("other", "/far") in node.get_node_names_and_namespaces())
    assert faults.counts["ros_discovery_info"] > 50
    assert "/far/other" in node.get_fully_qualified_node_names()


def test_fuzzed_user_data(node: Any, attacker: Attacker, wait_until: Any) -> None:
    generator = random.Random(3)
    alphabet = b"typehash=RIHS01_serviceid;clientid=.0123456789abcdef \x00\xff\xc3"
    topic = Topic(attacker.participant, "rr/fuzzReply", raw_type("std_srvs::srv::dds_::SetBool_Response_"))
    writers = []
    for _ in range(50):
        data = bytes(generator.choice(alphabet) for _ in range(generator.randrange(100)))
        writers.append(DataWriter(attacker.participant, topic, Qos(Policy.Userdata(data))))
    client = node.create_client(SetBool, "fuzz")
    assert wait_until(lambda: len(client.handle.get_matched_publications()) > 0)
    assert not client.service_is_ready()
    assert wait_until(lambda: len(node.get_publishers_info_by_topic("rr/fuzzReply", no_mangle=True)) == 50)
    node.get_service_names_and_types()


def test_garbage_on_the_discovery_ports(node: Any, spinner: Any, domain_id: int, wait_until: Any) -> None:
    generator = random.Random(4)
    head = b"RTPS\x02\x05\x01\x10" + bytes(12)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for number in range(600):
            body = generator.randbytes(generator.randrange(400))
            port = 7400 + 250 * domain_id + generator.choice((0, 10, 11, 12, 13))
            out.sendto((head if number % 2 else b"") + body, ("127.0.0.1", port))
    got: list[Any] = []
    node.create_subscription(String, "still_here", got.append, 10)
    publisher = node.create_publisher(String, "still_here", 10)
    assert wait_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(String(data="x"))
    assert spinner.until(lambda: got)
