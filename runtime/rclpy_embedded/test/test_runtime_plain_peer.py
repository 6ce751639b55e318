"""Peers on plain Cyclone DDS, which send XTypes information, match our endpoints by type name alone."""

from __future__ import annotations

import selectors
import sys
from typing import Any

import pytest
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.domain import DomainParticipant
from std_msgs.msg import String

PEER = """
import os
import sys
from dataclasses import dataclass
from cyclonedds.core import Policy, Qos, ReadCondition, SampleState, ViewState, InstanceState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

@dataclass
class Honest(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str

@dataclass
class Stub(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    anything: uint8

kind, direction = sys.argv[1:]
participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
cls = Honest if kind == "honest" else Stub
topic = Topic(participant, "rt/chatter", cls)
qos = Qos(Policy.DataRepresentation(use_cdrv0_representation=True), Policy.Reliability.Reliable(10**9))
if direction == "reads":
    reader = DataReader(participant, topic, qos)
    wait = WaitSet(participant)
    wait.attach(ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any))
    print("got" if wait.wait(duration(seconds=240)) else "nothing", flush=True)
else:
    writer = DataWriter(participant, topic, qos)
    print("ready", flush=True)
    for _ in sys.stdin:
        writer.write(cls("hello") if kind == "honest" else cls(7))
"""


@pytest.fixture
def peer(domain_id: int) -> Any:
    import os
    import subprocess

    from rclpy.impl import discovery

    started = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        environment = dict(os.environ, CYCLONEDDS_URI=discovery.configuration(domain_id, os.environ))
        process = subprocess.Popen(
            [sys.executable, "-c", PEER, *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("kind", ["honest", "stub"])
def test_peer_reads(node: Any, peer: Any, spinner: Any, kind: str) -> None:
    publisher = node.create_publisher(String, "chatter", 10)
    process = peer(kind, "reads")
    assert spinner.until(lambda: publisher.get_subscription_count() == 1)
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)

        def answered() -> bool:
            """What comes before the peer knows of our writer may be lost."""
            publisher.publish(String(data="hello"))
            return bool(selector.select(0.0))

        assert spinner.until(answered)
    assert process.stdout.readline().strip() == "got"


def test_peer_writes(node: Any, peer: Any, spinner: Any) -> None:
    heard: list[String] = []
    subscription = node.create_subscription(String, "chatter", heard.append, 10)
    process = peer("honest", "writes")
    assert process.stdout.readline().strip() == "ready"
    assert spinner.until(lambda: subscription.get_publisher_count() == 1)

    def answered() -> bool:
        """What the peer writes before it knows of our reader is lost."""
        process.stdin.write("go\n")
        process.stdin.flush()
        return bool(heard)

    assert spinner.until(answered)
    assert heard[0].data == "hello"


def test_no_type_information_is_announced(node: Any, domain_id: int, spinner: Any) -> None:
    node.create_publisher(String, "chatter", 10)
    participant = DomainParticipant(domain_id)
    reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    seen: list[Any] = []

    def found() -> bool:
        seen.extend(sample for sample in reader.take(100) if sample.topic_name == "rt/chatter")
        return bool(seen)

    assert spinner.until(found)
    assert [sample.type_id for sample in seen] == [None]
