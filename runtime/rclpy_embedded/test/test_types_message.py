"""Message classes behave as rosidl's Python generator makes them."""

from __future__ import annotations

import copy
import pickle
import threading
from array import array
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Polygon, Pose, PoseWithCovariance, Quaternion
from rcl_interfaces.msg import ParameterDescriptor, ParameterValue
from sensor_msgs.msg import BatteryState, Image, JointState, NavSatStatus, Temperature
from std_msgs.msg import (
    Bool,
    Byte,
    ByteMultiArray,
    Char,
    Empty,
    Float32,
    Float64,
    Float64MultiArray,
    Header,
    Int8,
    String,
    UInt64,
)
from std_srvs.srv import SetBool


def test_defaults() -> None:
    message = Temperature()
    assert message.header == Header()
    assert (message.temperature, message.variance) == (0.0, 0.0)
    assert Byte().data == b"\0"
    assert Char().data == 0
    assert Bool().data is False
    assert JointState().name == []
    assert JointState().position == array("d")
    assert PoseWithCovariance().covariance.dtype == np.float64
    assert PoseWithCovariance().covariance.shape == (36,)


def test_defaults_of_the_definition() -> None:
    assert Pose().orientation.w == 1.0
    assert Quaternion.W__DEFAULT == 1.0
    assert NavSatStatus().status == NavSatStatus.STATUS_UNKNOWN == -2


def test_every_message_has_its_own_defaults() -> None:
    first, second = JointState(), JointState()
    first.name.append("x")
    first.position.append(1.0)
    first.header.frame_id = "tool"
    assert second == JointState()


def test_keyword_arguments() -> None:
    message = Temperature(header=Header(frame_id="tool"), temperature=816.0)
    assert message.header.frame_id == "tool"
    assert message.temperature == 816.0
    with pytest.raises(TypeError):
        Temperature(Header())  # type: ignore[call-arg]
    with pytest.raises(AssertionError, match="Invalid arguments passed to constructor: celsius"):
        Temperature(celsius=1.0)  # type: ignore[call-arg]


def test_description_of_the_fields() -> None:
    assert Temperature.get_fields_and_field_types() == {
        "header": "std_msgs/Header",
        "temperature": "double",
        "variance": "double",
    }
    assert PoseWithCovariance.get_fields_and_field_types()["covariance"] == "double[36]"
    assert DiagnosticStatus.get_fields_and_field_types()["level"] == "octet"
    assert DiagnosticStatus.get_fields_and_field_types()["values"] == "sequence<diagnostic_msgs/KeyValue>"
    assert (
        ParameterDescriptor.get_fields_and_field_types()["integer_range"] == "sequence<rcl_interfaces/IntegerRange, 1>"
    )
    assert BatteryState.get_fields_and_field_types()["present"] == "boolean"
    assert Temperature.__slots__ == ["_header", "_temperature", "_variance", "_check_fields"]  # type: ignore[attr-defined]
    assert [type(slot).__name__ for slot in JointState.SLOT_TYPES] == ["NamespacedType", *["UnboundedSequence"] * 4]
    assert JointState.SLOT_TYPES[2].value_type.typename == "double"
    assert Empty.get_fields_and_field_types() == {}
    changed = Temperature.get_fields_and_field_types()
    changed.clear()
    assert Temperature.get_fields_and_field_types()


def test_constants_are_read_only() -> None:
    assert BatteryState.POWER_SUPPLY_STATUS_FULL == 4
    assert BatteryState().POWER_SUPPLY_STATUS_FULL == 4
    assert DiagnosticStatus.STALE == b"\x03"
    with pytest.raises(AttributeError):
        BatteryState.POWER_SUPPLY_STATUS_FULL = 5
    with pytest.raises(AttributeError):
        BatteryState().POWER_SUPPLY_STATUS_FULL = 5  # type: ignore[misc]


@pytest.mark.parametrize(
    ("cls", "value", "text"),
    [
        (Float64, 1, "The 'data' field must be of type 'float'"),
        (Float64, "1", "The 'data' field must be of type 'float'"),
        (Float64, None, "The 'data' field must be of type 'float'"),
        (Bool, 1, "The 'data' field must be of type 'bool'"),
        (String, b"x", "The 'data' field must be of type 'str'"),
        (Int8, 1.0, "The 'data' field must be of type 'int'"),
        (Int8, 128, r"The 'data' field must be an integer in \[-128, 127\]"),
        (Int8, -129, r"The 'data' field must be an integer in \[-128, 127\]"),
        (Char, 256, r"The 'data' field must be an unsigned integer in \[0, 255\]"),
        (UInt64, -1, r"The 'data' field must be an unsigned integer in \[0, 18446744073709551615\]"),
        (Float32, 1e39, r"The 'data' field must be a float in \[-3.402823466e\+38, 3.402823466e\+38\]"),
        (Byte, 1, "The 'data' field must be of type 'bytes' or 'ByteString' with length 1"),
        (Byte, b"12", "The 'data' field must be of type 'bytes' or 'ByteString' with length 1"),
        (Float64MultiArray, [1.0, "x"], "The 'data' field must be a set or sequence and each value of type 'float'"),
        (Float64MultiArray, [1], "The 'data' field must be a set or sequence and each value of type 'float'"),
        (Float64MultiArray, "abc", "The 'data' field must be a set or sequence and each value of type 'float'"),
        (Float64MultiArray, 1.0, "The 'data' field must be a set or sequence and each value of type 'float'"),
        (Float64MultiArray, array("f"), r"The 'data' array.array\(\) must have the type code of 'd'"),
        (ByteMultiArray, [1], "The 'data' field must be a set or sequence and each value of type 'bytes'"),
    ],
)
def test_assignment_is_checked(cls: Any, value: Any, text: str) -> None:
    message = cls()
    with pytest.raises(AssertionError, match=text):
        message.data = value
    assert message == cls()


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), 3.4e38])
def test_float32_takes_infinity(value: float) -> None:
    assert Float32(data=value).data == value
    assert np.isnan(Float32(data=float("nan")).data)


def test_assignment_of_messages_is_checked() -> None:
    with pytest.raises(AssertionError, match="The 'header' field must be a sub message of type 'Header'"):
        Temperature().header = String()  # type: ignore[assignment]
    status = DiagnosticStatus()
    status.values = [KeyValue(key="a")]
    with pytest.raises(AssertionError, match="a set or sequence and each value of type 'KeyValue'"):
        status.values = [KeyValue(), "a"]  # type: ignore[list-item]
    with pytest.raises(AssertionError, match="with length <= 1"):
        descriptor = ParameterDescriptor()
        descriptor.integer_range = [type(r)() for r in descriptor_ranges()] * 2


def descriptor_ranges() -> list[Any]:
    from rcl_interfaces.msg import IntegerRange

    return [IntegerRange()]


def test_unknown_fields_cannot_be_assigned() -> None:
    with pytest.raises(AttributeError):
        Temperature().celsius = 1.0  # type: ignore[attr-defined]


def test_checks_can_be_switched_off() -> None:
    message = Float64(check_fields=False)
    message.data = 1
    assert message.data == 1


def test_fixed_arrays() -> None:
    pose = PoseWithCovariance()
    pose.covariance = [float(i) for i in range(36)]
    assert isinstance(pose.covariance, np.ndarray)
    values = np.ones(36)
    pose.covariance = values
    assert pose.covariance is values
    with pytest.raises(AssertionError, match="must have a size of 36"):
        pose.covariance = np.ones(35)
    with pytest.raises(AssertionError, match=r"must have the dtype of 'numpy\.float64'"):
        pose.covariance = np.ones(36, np.float32)
    with pytest.raises(AssertionError, match="a set or sequence with length 36 and each value of type 'float'"):
        pose.covariance = [0.0] * 35
    with pytest.raises(AssertionError):
        PoseWithCovariance(covariance=[0.0] * 35)


def test_sequences_of_numbers() -> None:
    message = JointState(position=[1, 2])
    assert message.position == array("d", [1.0, 2.0])
    message.velocity = (1.0, 2.0)
    message.effort = np.array([1.0, np.nan])
    assert message.velocity == array("d", [1.0, 2.0])
    assert message.effort.typecode == "d" and len(message.effort) == 2
    message.effort = np.arange(4.0)[::2]
    assert message.effort.tolist() == [0.0, 2.0]
    kept = array("d", [3.0])
    message.position = kept
    assert message.position is kept
    with pytest.raises(AssertionError):
        message.position = np.ones((2, 2))


@pytest.mark.parametrize(
    "data", [b"\x00\xff", bytearray(b"\x00\xff"), [0, 255], np.array([0, 255]), memoryview(b"\0\xff")]
)
def test_bytes_of_an_image(data: Any) -> None:
    image = Image()
    image.data = data
    assert image.data == array("B", [0, 255])
    assert Image(data=data).data == array("B", [0, 255])


@pytest.mark.parametrize("data", [[256], [-1], ["a"], [1.5], np.array([256]), np.array([1.5])])
def test_bytes_out_of_range(data: Any) -> None:
    with pytest.raises(AssertionError, match=r"each unsigned integer in \[0, 255\]"):
        Image().data = data


def test_equality() -> None:
    one, other = PoseWithCovariance(), PoseWithCovariance()
    assert one == other
    other.covariance[35] = 1.0
    assert one != other
    assert one != Pose()  # type: ignore[comparison-overlap]
    assert Float64(data=float("nan")) != Float64(data=float("nan"))
    assert Empty() == Empty()
    with pytest.raises(TypeError):
        hash(one)


def test_repr() -> None:
    assert repr(String(data="x")) == "std_msgs.msg.String(data='x')"
    assert repr(SetBool.Request(data=True)) == "std_srvs.srv.SetBool_Request(data=True)"
    text = repr(JointState(name=["z"], position=[0.5]))
    assert text == (
        "sensor_msgs.msg.JointState(header=std_msgs.msg.Header(stamp=builtin_interfaces.msg.Time(sec=0, nanosec=0), "
        "frame_id=''), name=['z'], position=[0.5], velocity=[], effort=[])"
    )


@pytest.mark.parametrize("clone", [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_copies(clone: Any) -> None:
    for message in (
        JointState(name=["a"], position=[1.0]),
        PoseWithCovariance(covariance=[1.0] * 36),
        SetBool.Response(message="ok"),
    ):
        assert clone(message) == message
        assert type(clone(message)) is type(message)


def test_deep_copy_is_independent() -> None:
    message = Polygon()
    twin = copy.deepcopy(message)
    twin.points.append(type(Pose().position)())  # type: ignore[arg-type]
    assert message.points == []


def test_services() -> None:
    assert SetBool.Request.__name__ == "SetBool_Request"
    assert SetBool.Response(success=True).success
    assert SetBool.Event().request == []
    with pytest.raises(NotImplementedError):
        SetBool()


def test_parameter_value_with_all_kinds_of_arrays() -> None:
    value = ParameterValue(byte_array_value=[b"\1"], bool_array_value=[True], integer_array_value=[-1])
    assert value.integer_array_value.typecode == "q"
    assert value.bool_array_value == [True]
    with pytest.raises(AssertionError):
        value.string_array_value = "abc"


def test_classes_made_in_threads_are_the_same() -> None:
    from rosidl_embedded.typesupport import get_message

    made: list[Any] = []
    threads = [threading.Thread(target=lambda: made.append(get_message("nav_msgs/msg/Odometry"))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 8 and len(set(made)) == 1
