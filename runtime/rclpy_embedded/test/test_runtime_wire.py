"""What our entities look like on the wire, compared with what was captured from genuine ROS 2 Jazzy."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import Policy
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rclpy._rclpy_pybind11 import NodeNameNonExistentError
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.dds import qos_to_dds, raw_type
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile
from std_srvs.srv import Trigger

from rosidl_embedded.typesupport import get_message, type_support

GOLDEN = json.loads((Path(__file__).parent / "data" / "golden_wire.json").read_text())
KEEP_ALL = QoSProfile(history=QoSHistoryPolicy.KEEP_ALL)
LATCHED = QoSProfile(history=QoSHistoryPolicy.KEEP_ALL, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
SPIED = {
    "rq/go_homeRequest": "std_srvs::srv::dds_::Trigger_Request_",
    "rr/go_homeReply": "std_srvs::srv::dds_::Trigger_Response_",
    "rq/srv_node/set_parametersRequest": "rcl_interfaces::srv::dds_::SetParameters_Request_",
    "rr/srv_node/set_parametersReply": "rcl_interfaces::srv::dds_::SetParameters_Response_",
    "rt/parameter_events": "rcl_interfaces::msg::dds_::ParameterEvent_",
}
ROS_DISCOVERY_INFO = type_support(get_message("rmw_dds_common/msg/ParticipantEntitiesInfo"))


class Spy:
    """A participant that records raw samples and endpoints."""

    def __init__(self, domain_id: int) -> None:
        self.participant = DomainParticipant(domain_id)
        self.readers = {name: self._reader(name, dds_type, KEEP_ALL) for name, dds_type in SPIED.items()}
        self.info = self._reader("ros_discovery_info", ROS_DISCOVERY_INFO.dds_name, LATCHED)

    def _reader(self, name: str, dds_type: str, profile: QoSProfile) -> Any:
        topic = Topic(self.participant, name, raw_type(dds_type))
        return DataReader(self.participant, topic, qos_to_dds(profile, "", writer=False))

    def samples(self, name: str) -> list[bytes]:
        """Return the samples of a topic so far."""
        return [sample.data for sample in self.readers[name].read(1000) if sample.sample_info.valid_data]

    def endpoints(self, writers: bool) -> dict[str, Any]:
        """Return the endpoints of other participants by topic."""
        reader = BuiltinDataReader(
            self.participant, BuiltinTopicDcpsPublication if writers else BuiltinTopicDcpsSubscription
        )
        return {e.topic_name: e for e in reader.read(1000) if e.participant_key != self.participant.guid}


class Scene:
    """The two nodes of the capture, after the two calls and the setting of a parameter."""

    def __init__(self, domain_id: int) -> None:
        self.contexts = [Context(), Context()]
        for context in self.contexts:
            context.init(args=[], domain_id=domain_id)
        self.spy = Spy(domain_id)
        self.infos: list[list[Any]] = []
        self.server = rclpy.create_node("srv_node", context=self.contexts[0])
        self.server.create_service(Trigger, "go_home", self._answer)
        self.server.declare_parameter("gain", 1.5)
        self.client = rclpy.create_node("cli_node", namespace="ns", context=self.contexts[1])
        self.go_home = self.client.create_client(Trigger, "/go_home")
        self.executors = [SingleThreadedExecutor(context=context) for context in self.contexts]
        self.executors[0].add_node(self.server)
        self.executors[1].add_node(self.client)
        assert self.go_home.wait_for_service(120)
        for _ in range(2):
            self._complete(self.go_home.call_async(Trigger.Request()))
        self.set_gain = AsyncParameterClient(self.client, "/srv_node")
        assert self.set_gain.wait_for_services(120)
        self._complete(self.set_gain.set_parameters([Parameter("gain", value=2.5)]))

    @staticmethod
    def _answer(request: Any, response: Any) -> Any:
        response.success, response.message = True, "moved"
        return response

    def _complete(self, future: Any) -> None:
        for _ in range(2000):
            if future.done():
                return
            for executor in self.executors:
                executor.spin_once(timeout_sec=0.002)
        pytest.fail("no answer")

    def close(self) -> None:
        for executor in self.executors:
            executor.shutdown()
        for context in self.contexts:
            context.destroy()


@pytest.fixture
def scene(domain_id: int) -> Iterator[Scene]:
    scene = Scene(domain_id)
    yield scene
    scene.close()


def _golden_samples(topic: str) -> list[bytes]:
    return [bytes.fromhex(s["bytes"]) for s in GOLDEN["samples"] if s["topic"] == topic]


def _unpadded(data: bytes) -> bytes:
    return data.rstrip(b"\0")


def test_endpoints(scene: Scene) -> None:
    """Every captured endpoint has its twin: type, QoS policy by policy, USER_DATA up to the ids in it."""
    checked = set()
    for writers in (True, False):
        ours = scene.spy.endpoints(writers)
        for golden in GOLDEN["endpoints"]:
            if (golden["kind"] == "pub") != writers:
                continue
            twin = ours[golden["topic"]]
            assert twin.type_name == golden["type"]
            expected = {_without_ids(policy) for policy in golden["qos"]}
            assert {_without_ids(repr(policy)) for policy in twin.qos.policies} == expected, golden["topic"]
            checked.add((golden["kind"], golden["topic"]))
    assert len(checked) > 30


def _without_ids(policy: str) -> str:
    # The id stays in the notation of rmw; which one it is differs.
    return re.sub(r"(serviceid|clientid)= ?[0-9a-f]{1,2}(\.[0-9a-f]{1,2}){15};", r"\1=<id>;", policy)


def test_client_and_service_ids_belong_to_their_participants(scene: Scene) -> None:
    def id_of(endpoint: Any) -> str:
        return str(endpoint.qos[Policy.Userdata].data.decode().split(";")[0].split("=")[1])

    writers, readers = scene.spy.endpoints(True), scene.spy.endpoints(False)
    for request, reply, key in (
        (readers["rq/go_homeRequest"], writers["rr/go_homeReply"], readers["rq/go_homeRequest"].participant_key),
        (writers["rq/go_homeRequest"], readers["rr/go_homeReply"], writers["rq/go_homeRequest"].participant_key),
    ):
        assert id_of(request) == id_of(reply)
        assert id_of(request).startswith(" 1.10.")
        digits = bytes(int(byte, 16) for byte in id_of(request).split("."))
        assert digits[:12] == key.bytes[:12]


def test_participant(scene: Scene) -> None:
    reader = BuiltinDataReader(scene.spy.participant, BuiltinTopicDcpsParticipant)
    data = {p.qos[Policy.Userdata].data for p in reader.read(100) if p.qos[Policy.Userdata]}
    assert data == {b"enclave=/;"}


def test_service_bytes(scene: Scene) -> None:
    """Requests and replies equal the captured ones, but for the id of the client that they begin with."""
    for topic in ("go_home", "srv_node/set_parameters"):
        guids = set()
        for dds_topic in (f"rq/{topic}Request", f"rr/{topic}Reply"):
            golden, ours = _golden_samples(dds_topic), scene.spy.samples(dds_topic)
            # Numbers count per client; the one of set_parameters in the capture had waited for its services before.
            assert [_unpadded(data[20:]) for data in ours] == [_unpadded(data[20:]) for data in golden]
            assert all(data[:4] == b"\0\1\0\0" and len(data) % 4 == 0 for data in ours)
            assert [len(data) for data in ours] == [len(data) for data in golden]
            guids |= {data[4:12] for data in ours}
        assert len(guids) == 1
    numbers = [int.from_bytes(data[12:20], "little") for data in scene.spy.samples("rq/go_homeRequest")]
    assert numbers == [1, 2]


def test_parameter_events(scene: Scene) -> None:
    """The events of srv_node equal the captured ones, but for the stamp."""
    golden = [data for data in _golden_samples("rt/parameter_events") if b"/srv_node\0" in data]
    ours = [data for data in scene.spy.samples("rt/parameter_events") if b"/srv_node\0" in data]
    assert [_unpadded(data[12:]) for data in ours] == [_unpadded(data[12:]) for data in golden]


def test_discovery_samples_round_trip() -> None:
    for data in _golden_samples("ros_discovery_info"):
        message = ROS_DISCOVERY_INFO.deserialize(data)
        assert _unpadded(ROS_DISCOVERY_INFO.serialize(message)) == _unpadded(data)


def _shape(message: Any) -> list[tuple[str, str, int, int]]:
    return [
        (node.node_namespace, node.node_name, len(node.reader_gid_seq), len(node.writer_gid_seq))
        for node in message.node_entities_info_seq
    ]


def test_discovery_info_of_a_life(domain_id: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """From birth to death, /ns/cli_node announces the captured states; GUIDs are put in for each other."""
    from rclpy.impl.session import Session

    announced: list[bytes] = []
    original = Session._announce

    def record(self: Session) -> None:
        original(self)
        announced.append(self._info_writer_sample())

    def sample(self: Session) -> bytes:
        reader = self.info_reader
        return bytes(reader.read(100)[-1].data)

    monkeypatch.setattr(Session, "_announce", record)
    monkeypatch.setattr(Session, "_info_writer_sample", sample, raising=False)
    context = Context()
    context.init(args=[], domain_id=domain_id)
    try:
        node = rclpy.create_node("cli_node", namespace="/ns", context=context)
        client = node.create_client(Trigger, "/go_home")
        parameters = node.create_client(_set_parameters(), "/srv_node/set_parameters")
        assert client and parameters
        node.destroy_node()
    finally:
        context.destroy()
    golden = [
        ROS_DISCOVERY_INFO.deserialize(data)
        for data in _golden_samples("ros_discovery_info")
        if b"cli_node\0" in data or b"\xa4\x61\xb1\x00\x00\x01\xc1" in data
    ]
    ours = [ROS_DISCOVERY_INFO.deserialize(data) for data in announced]
    birth = [_shape(message) for message in golden if _shape(message)]
    growing = [shape for shape in birth[: birth.index(max(birth, key=lambda s: s[0][2] + s[0][3])) + 1]]
    shapes = [_shape(message) for message in ours]
    # Our client of a single service joins at the same place as the captured ones.
    assert [shape for shape in growing if shape in shapes] == growing
    assert shapes[-1] == _shape(golden[-1]) == []
    richest = max(ours, key=lambda message: len(ROS_DISCOVERY_INFO.serialize(message)))
    twin = max(golden, key=lambda message: len(ROS_DISCOVERY_INFO.serialize(message)))
    assert _unpadded(_substituted(richest, twin)) == _unpadded(ROS_DISCOVERY_INFO.serialize(twin))


def _set_parameters() -> Any:
    from rcl_interfaces.srv import SetParameters

    return SetParameters


def _substituted(ours: Any, golden: Any) -> bytes:
    """Return our message with the golden GUIDs at the places where ours are."""
    data = ROS_DISCOVERY_INFO.serialize(ours)
    pairs = [(ours.gid, golden.gid)]
    for mine, theirs in zip(ours.node_entities_info_seq, golden.node_entities_info_seq, strict=True):
        pairs += zip(mine.reader_gid_seq, theirs.reader_gid_seq, strict=True)
        pairs += zip(mine.writer_gid_seq, theirs.writer_gid_seq, strict=True)
    for mine, theirs in pairs:
        data = data.replace(bytes(mine.data), bytes(theirs.data))
    return bytes(data)


def test_captured_nodes_show_in_our_graph(context: Context, node: Any, wait_until: Any) -> None:
    """A genuine participant's last full announcement, replayed, appears in the graph once its participant is alive."""
    other = Context()
    other.init(args=[], domain_id=context.get_domain_id())
    try:
        session = other.session
        golden = next(data for data in _golden_samples("ros_discovery_info") if b"cli_node\0" in data)
        ours = golden.replace(golden[4:20], session.participant.guid.bytes)
        session._info_writer.write(raw_type(ROS_DISCOVERY_INFO.dds_name)(ours))
        assert wait_until(lambda: "/ns/cli_node" in node.get_fully_qualified_node_names())
        with pytest.raises(NodeNameNonExistentError):
            node.get_publisher_names_and_types_by_node("cli_node", "/")
    finally:
        other.destroy()
