"""Bytes and hashes recorded from genuine ROS 2 Jazzy."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from rosidl_embedded import catalogue
from rosidl_embedded.definition import AbstractNestedType, BasicType, NamespacedType
from rosidl_embedded.description import type_description
from rosidl_embedded.typesupport import get_interface, get_message, type_hash, type_support

DATA = Path(__file__).parent / "data"
GOLDEN = json.loads((DATA / "golden_cdr.json").read_text())
WIRE = json.loads((DATA / "golden_wire.json").read_text())
SERVICE_HEADER_SIZE = 16
DISCOVERY = "rmw_dds_common/msg/ParticipantEntitiesInfo"


def from_values(type_: Any, value: Any) -> Any:
    """Make what a field of the type holds from the plain values of the golden file."""
    if isinstance(type_, NamespacedType):
        return message_from_values(type_.type_name, value)
    if isinstance(type_, AbstractNestedType):
        return [from_values(type_.value_type, item) for item in value]
    if isinstance(type_, BasicType) and type_.typename == "octet":
        return bytes(value if isinstance(value, list) else [value])
    return value


def message_from_values(type_name: str, values: dict[str, Any]) -> Any:
    definition = catalogue.structure(type_name)
    assert [field.name for field in definition.fields] == list(values)
    return get_message(type_name)(
        **{field.name: from_values(field.type, values[field.name]) for field in definition.fields}
    )


def support_of_topic(topic: str) -> tuple[Any, int]:
    """Type support and size of the prefix of a sample's topic."""
    if topic == "ros_discovery_info":
        return type_support(get_message(DISCOVERY)), 0
    if topic == "rt/parameter_events":
        return type_support(get_message("rcl_interfaces/msg/ParameterEvent")), 0
    name = "rcl_interfaces/srv/SetParameters" if "set_parameters" in topic else "std_srvs/srv/Trigger"
    service = get_interface(name)
    return type_support(service.Request if topic.startswith("rq/") else service.Response), SERVICE_HEADER_SIZE


def test_messages_encode_to_the_golden_bytes_and_decode_back() -> None:
    for entry in GOLDEN["messages"]:
        message = message_from_values(entry["type"], entry["values"])
        support = type_support(type(message))
        golden = bytes.fromhex(entry["cdr"])
        assert support.serialize(message).hex() == entry["cdr"], entry["type"]
        assert support.deserialize(golden) == message, entry["type"]
        assert support.deserialize(memoryview(golden + bytes(-len(golden) % 4))) == message, entry["type"]


def test_all_type_hashes_match() -> None:
    assert len(GOLDEN["type_hashes"]) == 209
    assert {name: type_hash(name) for name in GOLDEN["type_hashes"]} == GOLDEN["type_hashes"]


def test_action_hashes_match_those_of_the_genuine_generator() -> None:
    golden = json.loads((DATA / "golden_action_hashes.json").read_text())
    assert len(golden) == 26
    assert {name: type_hash(name) for name in golden} == golden


def test_captured_samples_decode_and_encode_identically() -> None:
    for index, sample in enumerate(WIRE["samples"]):
        where = f"sample {index} of {sample['topic']}"
        support, size = support_of_topic(sample["topic"])
        captured = bytes.fromhex(sample["bytes"])
        prefix, message = support.deserialize_with_prefix(captured, size)
        assert len(prefix) == size, where
        encoded = support.serialize(message, prefix)
        assert (encoded + bytes(-len(encoded) % 4)).hex() == sample["bytes"], where


def test_captured_reply_says_what_the_server_answered() -> None:
    reply = next(sample for sample in WIRE["samples"] if sample["topic"] == "rr/go_homeReply")
    support, size = support_of_topic(reply["topic"])
    prefix, message = support.deserialize_with_prefix(bytes.fromhex(reply["bytes"]), size)
    assert (message.success, message.message) == (True, "moved")
    assert int.from_bytes(prefix[8:], "little") == 1


def test_captured_discovery_names_the_node() -> None:
    samples = [s for s in WIRE["samples"] if s["topic"] == "ros_discovery_info"]
    info = type_support(get_message(DISCOVERY)).deserialize(bytes.fromhex(samples[0]["bytes"]))
    (node,) = info.node_entities_info_seq
    assert (node.node_namespace, node.node_name) == ("/", "srv_node")
    assert len(node.reader_gid_seq) + len(node.writer_gid_seq) == 1


def test_names_on_the_wire() -> None:
    service = get_interface("std_srvs/srv/Trigger")
    assert type_support(service.Request).dds_name == "std_srvs::srv::dds_::Trigger_Request_"
    assert type_support(service.Response).type_hash == GOLDEN["type_hashes"]["std_srvs/srv/Trigger_Response"]
    assert type_support(get_message("std_msgs/String")).dds_name == "std_msgs::msg::dds_::String_"


def test_hashes_of_captured_endpoints() -> None:
    captured, computed = {}, {}
    for endpoint in WIRE["endpoints"]:
        found = re.search(r"typehash=(RIHS01_[0-9a-f]{64});", str(endpoint["qos"]))
        if found is not None:
            name = endpoint["type"].replace("::dds_::", "::").replace("::", "/").removesuffix("_")
            captured[name] = found[1]
            computed[name] = type_hash(name)
    assert len(captured) >= 15
    assert computed == captured


def test_description_has_the_members_of_its_message() -> None:
    described = type_description("std_msgs/Header")
    assert list(described) == list(
        get_message("type_description_interfaces/msg/TypeDescription")._fields_and_field_types
    )
    stamp, frame = described["type_description"]["fields"]
    assert stamp["type"]["nested_type_name"] == described["referenced_type_descriptions"][0]["type_name"]
    assert (frame["name"], frame["type"]["type_id"]) == ("frame_id", 17)
