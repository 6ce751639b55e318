"""Encoding and decoding of all known types: round trips, another implementation as a judge, and malformed data."""

from __future__ import annotations

import struct
import tracemalloc
from array import array
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from rosidl_embedded import catalogue
from rosidl_embedded.definition import (
    INTEGER_RANGES,
    AbstractGenericString,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
    element_type,
)
from rosidl_embedded.search import definitions
from rosidl_embedded.typesupport import DeserializationError, SerializationError, TypeSupport, get_message, type_support

STORE = get_typestore(Stores.ROS2_JAZZY)
SERVICE_PACKAGES = (
    "std_srvs",
    "rcl_interfaces",
    "example_interfaces",
    "composition_interfaces",
    "map_msgs",
    "nav_msgs",
    "rosbag2_interfaces",
    "fsw_msgs",
    "test_msgs",
)
SERVICES = [
    f"{package}/srv/{name}_{part}"
    for package in SERVICE_PACKAGES
    for name in definitions(package, "srv")
    for part in ("Request", "Response", "Event")
]
ACTIONS = [
    f"{package}/action/{name}_{part}"
    for package in ("example_interfaces", "fsw_msgs", "test_msgs")
    for name in definitions(package, "action")
    for part in ("SendGoal_Request", "SendGoal_Response", "GetResult_Response", "FeedbackMessage")
]
OTHERS = [
    f"{package}/msg/{name}"
    for package in ("fsw_msgs", "test_msgs", "example_interfaces", "map_msgs")
    for name in definitions(package, "msg")
]
TYPES = sorted(STORE.fielddefs) + SERVICES + ACTIONS + OTHERS
PACKAGES = sorted({type_name.partition("/")[0] for type_name in TYPES})
HEADER = b"\x00\x01\x00\x00"


def types_of(package: str) -> list[str]:
    return [type_name for type_name in TYPES if type_name.partition("/")[0] == package]


def element_values(type_: AbstractType) -> st.SearchStrategy[Any]:
    if isinstance(type_, NamespacedType):
        return messages(type_.type_name)
    if isinstance(type_, AbstractGenericString):
        bound = type_.maximum_size
        # Half of a surrogate pair is no text; narrow strings cannot hold it either.
        return st.text(st.characters(exclude_categories=["Cs"]), max_size=5 if bound is None else min(bound, 5))
    assert isinstance(type_, BasicType)
    if type_.typename == "octet":
        return st.binary(min_size=1, max_size=1)
    if type_.typename == "boolean":
        return st.booleans()
    if type_.typename in INTEGER_RANGES:
        return st.integers(*INTEGER_RANGES[type_.typename])
    if type_.typename == "float":
        # rosidl's limit is a little below the largest float32.
        return st.floats(-(2.0**127), 2.0**127, width=32)
    return st.floats(allow_nan=False)


def field_values(type_: AbstractType) -> st.SearchStrategy[Any]:
    element = element_type(type_)
    values = element_values(element)
    if element is type_:
        return values
    if isinstance(type_, Array):
        return st.lists(values, min_size=type_.size, max_size=type_.size)
    return st.lists(values, max_size=min(type_.maximum_size, 2) if isinstance(type_, BoundedSequence) else 2)


@st.composite
def messages(draw: st.DrawFn, type_name: str) -> Any:
    fields = catalogue.structure(type_name).fields
    return get_message(type_name)(**{field.name: draw(field_values(field.type)) for field in fields})


any_message = st.sampled_from(TYPES).flatmap(messages)


def decode_or_refuse(support: TypeSupport, data: bytes) -> None:
    try:
        support.deserialize(data)
    except DeserializationError as error:
        assert support.type_name in str(error)


def test_there_are_many_types() -> None:
    assert len(TYPES) > 250


@pytest.mark.parametrize("package", PACKAGES)
def test_default_message_of_every_type(package: str) -> None:
    prefix = bytes(range(16))
    for type_name in types_of(package):
        support = type_support(get_message(type_name))
        message = support.cls()
        data = support.serialize(message)
        assert support.deserialize(data) == message, type_name
        prefixed = support.serialize(message, prefix)
        assert support.deserialize_with_prefix(prefixed, 16) == (prefix, message), type_name


@given(any_message)
def test_round_trip(message: Any) -> None:
    support = type_support(type(message))
    data = support.serialize(message)
    decoded = support.deserialize(data)
    assert decoded == message
    assert support.serialize(decoded) == data
    prefixed = support.serialize(message, bytes(16))
    assert prefixed[20:] == data[4:]


@given(st.sampled_from(sorted(STORE.fielddefs)).flatmap(messages))
def test_rosbags_reads_and_writes_the_same_bytes(message: Any) -> None:
    support = type_support(type(message))
    data = support.serialize(message)
    other = STORE.deserialize_cdr(data, support.type_name)
    assert bytes(STORE.serialize_cdr(other, support.type_name, little_endian=True)) == data
    big_endian = bytes(STORE.serialize_cdr(other, support.type_name, little_endian=False))
    with pytest.raises(DeserializationError, match="only little-endian"):
        support.deserialize(big_endian)


@given(st.sampled_from(TYPES), st.binary(max_size=200))
def test_random_bytes(type_name: str, data: bytes) -> None:
    support = type_support(get_message(type_name))
    decode_or_refuse(support, data)
    decode_or_refuse(support, HEADER + data)


@given(any_message, st.data())
def test_damaged_bytes(message: Any, data: st.DataObject) -> None:
    support = type_support(type(message))
    encoded = support.serialize(message)
    position = data.draw(st.integers(0, len(encoded) - 1))
    flipped = bytearray(encoded)
    flipped[position] ^= 1 << data.draw(st.integers(0, 7))
    decode_or_refuse(support, bytes(flipped))
    huge = bytearray(encoded)
    huge[position : position + 4] = b"\xff\xff\xff\x7f"
    decode_or_refuse(support, bytes(huge))
    with pytest.raises(DeserializationError):
        support.deserialize(encoded[:position])
    with pytest.raises(DeserializationError):
        support.deserialize(encoded + bytes(4))


@pytest.mark.parametrize("package", PACKAGES)
def test_memory_is_bounded_by_the_size_of_the_data(package: str) -> None:
    words = (b"\xff\xff\xff\xff", b"\x00\x00\x00\x10", b"\x40\x00\x00\x00", b"\x01\x00\x00\x00", bytes(4))
    for type_name in types_of(package):
        support = type_support(get_message(type_name))
        support.deserialize(support.serialize(support.cls()))
        for word in words:
            data = HEADER + word * 256
            tracemalloc.start()
            decode_or_refuse(support, data)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert peak < 64 * len(data) + 50_000, f"{type_name} from {word.hex()}"


@pytest.mark.parametrize("encapsulation", [b"\x00\x03", b"\x00\x02", b"\x00\x07", b"\x01\x00", b"\xff\xff"])
def test_unknown_encapsulation(encapsulation: bytes) -> None:
    support = type_support(get_message("std_msgs/msg/Bool"))
    with pytest.raises(DeserializationError, match=f"encapsulation {encapsulation.hex()}"):
        support.deserialize(encapsulation + b"\x00\x00\x01")


@pytest.mark.parametrize("data", [b"", b"\x00", b"\x00\x01", b"\x00\x01\x00", b"\x00\x01\x00\x00"])
def test_no_content(data: bytes) -> None:
    with pytest.raises(DeserializationError):
        type_support(get_message("std_msgs/msg/Empty")).deserialize(data)


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (b"\x03\x00\x00\x00\xff\xfe\x00", "utf-8"),
        (b"\x03\x00\x00\x00abc", "not terminated"),
        (b"\x04\x00\x00\x00ab\x00", "index out of range"),
        (b"\xff\xff\xff\xff", "index out of range"),
        (b"\x02\x00\x00\x00a\x00abcd", "bytes too many"),
    ],
)
def test_malformed_string(body: bytes, text: str) -> None:
    with pytest.raises(DeserializationError, match=text):
        type_support(get_message("std_msgs/msg/String")).deserialize(HEADER + body)


def test_string_without_terminator_of_length_zero_is_empty() -> None:
    assert type_support(get_message("std_msgs/msg/String")).deserialize(HEADER + bytes(4)).data == ""


def test_sequence_longer_than_its_bound() -> None:
    support = type_support(get_message("shape_msgs/msg/SolidPrimitive"))
    assert support.deserialize(HEADER + bytes([1, 0, 0, 0]) + struct.pack("<II", 0, 0)).dimensions == array("d")
    with pytest.raises(DeserializationError, match="longer than its bound"):
        support.deserialize(HEADER + bytes([1, 0, 0, 0]) + struct.pack("<I4d", 4, 1, 2, 3, 4) + bytes(8))


def test_decoded_containers() -> None:
    support = type_support(get_message("sensor_msgs/msg/CameraInfo"))
    message = support.deserialize(support.serialize(support.cls(d=[1.0])))
    assert isinstance(message.d, array) and message.d.typecode == "d"
    message.k[0] = 1.0
    message.d.append(2.0)
    message.k = message.k.copy()


def test_contents_changed_in_place_are_refused() -> None:
    joints = get_message("sensor_msgs/msg/JointState")()
    joints.name.append(5)
    with pytest.raises(SerializationError, match="cannot serialize sensor_msgs/msg/JointState: "):
        type_support(type(joints)).serialize(joints)
    pose = get_message("geometry_msgs/msg/PoseWithCovariance")()
    pose.covariance.resize(3, refcheck=False)
    with pytest.raises(SerializationError, match="covariance must have 36 values"):
        type_support(type(pose)).serialize(pose)
    with pytest.raises(SerializationError, match="expected a message of type geometry_msgs/msg/PoseWithCovariance"):
        type_support(type(pose)).serialize(joints)
    text = get_message("std_msgs/msg/String")(data="\ud800")
    with pytest.raises(SerializationError):
        type_support(type(text)).serialize(text)


def test_large_image_is_one_block() -> None:
    image = get_message("sensor_msgs/msg/Image")(data=bytes(range(256)) * 4096)
    support = type_support(type(image))
    assert support.deserialize(support.serialize(image)).data == image.data
