"""What users read of errors, word for word."""

from __future__ import annotations

import array
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovariance
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, ParameterValue
from rclpy.clock import Clock, JumpThreshold
from rclpy.duration import Duration
from rclpy.exceptions import (
    InvalidHandle,
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    ParameterException,
)
from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible, qos_profile_system_default
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from rclpy.validate_topic_name import validate_topic_name
from std_msgs.msg import Bool, Byte, Float32, Float64, Float64MultiArray, Header, Int8, String, UInt8
from type_description_interfaces.msg import FieldType

SECOND = Duration(seconds=1)
LONGER = Duration(seconds=2)
DOUBLES = f"each value of type 'float' and each double in [{-1.7976931348623157e308:f}, {1.7976931348623157e308:f}]"


@pytest.mark.parametrize(
    ("offered", "requested", "reason"),
    [
        ({"reliability": 2}, {"reliability": 1}, "ERROR: Best effort publisher and reliable subscription;"),
        ({"durability": 2}, {"durability": 1}, "ERROR: Volatile publisher and transient local subscription;"),
        ({}, {"deadline": SECOND}, "ERROR: Subscription has a deadline, but publisher does not;"),
        (
            {"deadline": LONGER},
            {"deadline": SECOND},
            "ERROR: Subscription deadline is less than publisher deadline;",
        ),
        (
            {"liveliness": 1},
            {"liveliness": 3},
            "ERROR: Publisher's liveliness is automatic and subscription's is manual by topic;",
        ),
        (
            {},
            {"liveliness_lease_duration": SECOND},
            "ERROR: Subscription has a liveliness lease duration, but publisher does not;",
        ),
        (
            {"liveliness_lease_duration": LONGER},
            {"liveliness_lease_duration": SECOND},
            "ERROR: Subscription liveliness lease duration is less than publisher;",
        ),
        (
            {"reliability": 2, "deadline": LONGER, "liveliness": 1},
            {"reliability": 1, "deadline": SECOND, "liveliness": 3},
            "ERROR: Best effort publisher and reliable subscription;"
            "ERROR: Subscription deadline is less than publisher deadline;"
            "ERROR: Publisher's liveliness is automatic and subscription's is manual by topic;",
        ),
        ({"reliability": 0}, {}, "WARNING: Reliable subscription, but publisher is system_default;"),
        ({"reliability": 2}, {"reliability": 3}, "WARNING: Best effort publisher, but subscription is unknown;"),
        (
            {"durability": 3},
            {"durability": 1},
            "WARNING: Transient local subscription, but publisher is unknown;",
        ),
        ({}, {"durability": 0}, "WARNING: Volatile publisher, but subscription is system_default;"),
        (
            {"liveliness": 0},
            {"liveliness": 3},
            "WARNING: Subscription's liveliness is manual by topic, but publisher's is system_default;",
        ),
        (
            {"liveliness": 1},
            {"liveliness": 4},
            "WARNING: Publisher's liveliness is automatic, but subscription's is unknown;",
        ),
    ],
)
def test_qos(offered: dict[str, Any], requested: dict[str, Any], reason: str) -> None:
    def profile(policies: dict[str, Any]) -> QoSProfile:
        return QoSProfile(depth=1, **{"liveliness": 1, **policies})

    verdict = QoSCompatibility.ERROR if reason.startswith("ERROR") else QoSCompatibility.WARNING
    assert qos_check_compatible(profile(offered), profile(requested)) == (verdict, reason)


def test_qos_left_to_the_system() -> None:
    reason = (
        "WARNING: Publisher reliability is system_default and subscription reliability is system_default;"
        "WARNING: Publisher durabilty is system_default and subscription durability is system_default;"
        "WARNING: Publisher liveliness is system_default and subscription liveliness is system_default;"
    )
    profile = qos_profile_system_default
    assert qos_check_compatible(profile, profile) == (QoSCompatibility.WARNING, reason)
    with pytest.warns(UserWarning) as warnings:
        QoSProfile(depth=0)
    assert str(warnings[0].message) == (
        "A zero depth with KEEP_LAST doesn't make sense; no data could be stored. "
        "This will be interpreted as SYSTEM_DEFAULT"
    )


@pytest.mark.parametrize(
    ("cls", "field", "value", "text"),
    [
        (String, "data", 1, "The 'data' field must be of type 'str'"),
        (Bool, "data", 1, "The 'data' field must be of type 'bool'"),
        (Float64, "data", 1, "The 'data' field must be of type 'float'"),
        (Float32, "data", 1e39, "The 'data' field must be a float in [-3.402823466e+38, 3.402823466e+38]"),
        (Int8, "data", 1.0, "The 'data' field must be of type 'int'"),
        (Int8, "data", 128, "The 'data' field must be an integer in [-128, 127]"),
        (UInt8, "data", -1, "The 'data' field must be an unsigned integer in [0, 255]"),
        (Byte, "data", b"ab", "The 'data' field must be of type 'bytes' or 'ByteString' with length 1"),
        (Header, "stamp", 1.0, "The 'stamp' field must be a sub message of type 'Time'"),
        (
            FieldType,
            "nested_type_name",
            "x" * 256,
            "The 'nested_type_name' field must be string value not longer than 255",
        ),
        (Float64MultiArray, "data", [1], f"The 'data' field must be a set or sequence and {DOUBLES}"),
        (Float64MultiArray, "data", array.array("f"), "The 'data' array.array() must have the type code of 'd'"),
        (
            ParameterValue,
            "string_array_value",
            "abc",
            "The 'string_array_value' field must be a set or sequence and each value of type 'str'",
        ),
        (
            ParameterDescriptor,
            "integer_range",
            [IntegerRange(), IntegerRange()],
            "The 'integer_range' field must be a set or sequence with length <= 1 "
            "and each value of type 'IntegerRange'",
        ),
        (
            PoseWithCovariance,
            "covariance",
            [0.0],
            f"The 'covariance' field must be a set or sequence with length 36 and {DOUBLES}",
        ),
        (
            PoseWithCovariance,
            "covariance",
            np.zeros(36, np.float32),
            "The 'covariance' numpy.ndarray() must have the dtype of 'numpy.float64'",
        ),
        (PoseWithCovariance, "covariance", np.zeros(3), "The 'covariance' numpy.ndarray() must have a size of 36"),
    ],
)
def test_message_fields(cls: Any, field: str, value: Any, text: str) -> None:
    message = cls(check_fields=True)
    with pytest.raises(AssertionError) as error:
        setattr(message, field, value)
    # pytest may add to it what the assertion compared.
    assert str(error.value).splitlines()[0] == text


@pytest.mark.parametrize(
    ("validate", "name", "error", "text", "index"),
    [
        (validate_topic_name, "", "topic", "topic name must not be empty string", 0),
        (validate_topic_name, "a/", "topic", "topic name must not end with a forward slash", 1),
        (
            validate_topic_name,
            "a b",
            "topic",
            "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'",
            1,
        ),
        (validate_full_topic_name, "a", "topic", "topic name must be absolute, it must lead with a '/'", 0),
        (validate_full_topic_name, "/a//b", "topic", "topic name must not contain repeated '/'", 3),
        (validate_namespace, "/a/", "namespace", "namespace must not end with a '/', unless only a '/'", 2),
        (validate_namespace, "/1", "namespace", "namespace must not have a token that starts with a number", 1),
        (
            validate_node_name,
            "a/b",
            "node",
            "node name must not contain characters other than alphanumerics or '_'",
            1,
        ),
    ],
)
def test_names(validate: Any, name: str, error: str, text: str, index: int) -> None:
    exceptions = {
        "topic": (InvalidTopicNameException, "topic name"),
        "namespace": (InvalidNamespaceException, "namespace"),
        "node": (InvalidNodeNameException, "node name"),
    }
    exception, kind = exceptions[error]
    expected = f"Invalid {kind}: {text}:\n  '{name}'\n   {' ' * index}^"
    with pytest.raises(exception) as raised:
        validate(name)
    assert str(raised.value) == expected
    if error == "topic":
        with pytest.raises(InvalidServiceNameException) as raised:
            validate(name, is_service=True)
        assert str(raised.value) == expected.replace("Invalid topic name", "Invalid service name")


def assert_said(*cases: tuple[Callable[[], object], type[Exception], str]) -> None:
    """Each action raises its error with this very text."""
    for act, error, text in cases:
        with pytest.raises(error) as raised:
            act()
        assert str(raised.value) == text


def test_declaring_parameters(node: Any) -> None:
    dynamic = ParameterDescriptor(dynamic_typing=True)
    bounded = ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=10, step=2)])
    node.declare_parameter("number", 1)
    assert_said(
        (lambda: node.declare_parameter("", 1), ParameterException, "Invalid parameter name: "),
        (
            lambda: node.declare_parameter("number", 1),
            ParameterException,
            "Parameter(s) already declared: ['number']",
        ),
        (
            lambda: node.declare_parameter("p", 5, bounded),
            ParameterException,
            "Invalid parameter value (5) for parameter. Reason: The parameter value for p is not a valid step. "
            "Min: 0, max: 10, value: 5, step: 2: p",
        ),
        (
            lambda: node.declare_parameter("p", Parameter.Type.NOT_SET),
            ValueError,
            "Cannot declare parameter {p} as statically typed of type NOT_SET",
        ),
        (
            lambda: node.declare_parameter("p", None, ParameterDescriptor()),
            ValueError,
            "Cannot declare a statically typed parameter with default value of type PARAMETER_NOT_SET",
        ),
        (
            lambda: node.declare_parameter("p", Parameter.Type.INTEGER, dynamic),
            ValueError,
            "When declaring parameter {p} passing a descriptor with`dynamic_typing=True` "
            "is not allowed when the parameter type is provided",
        ),
        (
            lambda: node.declare_parameters("", [("p", 1), (2, 1)]),
            TypeError,
            "First element 2 at index 1 in parameters list is not a str.",
        ),
        (
            lambda: node.declare_parameters("", [("p", 1, 2)]),
            TypeError,
            "Third element 2 at index 0 in parameters list is not a ParameterDescriptor.",
        ),
        (
            lambda: node.declare_parameters("", [()]),
            TypeError,
            "Invalid parameter tuple length at index 0 in parameters list: (); expecting length between 1 and 3",
        ),
    )
    assert not node.has_parameter("p")


def test_asking_for_parameters_and_undeclaring_them(node: Any) -> None:
    node.declare_parameter("fixed", 1, ParameterDescriptor(read_only=True))
    node.declare_parameter("typed", Parameter.Type.DOUBLE)
    assert_said(
        (lambda: node.get_parameter("p"), ParameterException, "Invalid access to undeclared parameter(s): p"),
        (
            lambda: node.get_parameter("typed"),
            ParameterException,
            "The parameter 'typed' is not initialized: typed",
        ),
        (
            lambda: node.undeclare_parameter("fixed"),
            ParameterException,
            "Attempted to modify read-only parameter: fixed",
        ),
        (lambda: node.list_parameters("a", 0), TypeError, "The prefixes argument must be a list"),
        (lambda: node.list_parameters([1], 0), TypeError, "All prefixes must be instances of type str"),
    )


def test_making_parameters() -> None:
    assert_said(
        (
            lambda: Parameter("p", Parameter.Type.INTEGER, "x"),
            ValueError,
            "Type 'Type.INTEGER' and value 'x' do not agree",
        ),
        (
            lambda: Parameter("p", value=[1, "x"]),
            TypeError,
            "The given value is not a list of one of the allowed types '[1, 'x']'.",
        ),
    )


def test_declaring_a_parameter_by_its_name(node: Any) -> None:
    with pytest.warns(UserWarning) as warnings:
        node.declare_parameter("p")
    assert str(warnings[0].message).startswith(
        "when declaring parameter named 'p', "
        "declaring a parameter only providing its name is deprecated. You have to either:\n"
    )


def test_setting_parameters(node: Any) -> None:
    integers = ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=10, step=2)])
    floats = ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=0.0, to_value=2.0, step=0.5)])
    node.declare_parameter("number", 2, integers)
    node.declare_parameter("gain", 1.0, floats)
    node.declare_parameter("fixed", 1, ParameterDescriptor(read_only=True))
    for name, value, reason in (
        ("fixed", 2, "Trying to set a read-only parameter: fixed."),
        ("number", "a", "Wrong parameter type, expected 'Type.INTEGER' got 'Type.STRING'"),
        ("number", None, "Static parameter cannot be undeclared"),
        ("number", 11, "Parameter number out of range. Min: 0, Max: 10, value: 11"),
        (
            "number",
            5,
            "The parameter value for number is not a valid step. Min: 0, max: 10, value: 5, step: 2",
        ),
        ("gain", 3.0, "Parameter gain out of range Min: 0.0, Max: 2.0, value: 3.0"),
        (
            "gain",
            0.7,
            "The parameter value for gain is not close enough to a valid step. "
            "Min: 0.0, max: 2.0, value: 0.7, step: 0.5",
        ),
    ):
        result = node.set_parameters_atomically([Parameter(name, value=value)])
        assert (result.successful, result.reason) == (False, reason)
    node.add_pre_set_parameters_callback(lambda parameters: [])
    assert node.set_parameters_atomically([Parameter("number", value=4)]).reason == (
        "parameter list cannot be empty, this might be due to pre_set_parameters_callback modifying the original "
        "parameters list."
    )


def test_log_calls() -> None:
    logger = get_logger("texts")
    for calls, text in (
        ([{"severity": 20}, {"severity": 30}], "Logger severity cannot be changed between calls."),
        ([{"name": "a"}, {"name": "b"}], "Logger name cannot be changed between calls."),
        ([{"once": True}, {"skip_first": True}], "Requested logging filters cannot be changed between calls."),
        (
            [{"throttle_duration_sec": 1}, {"throttle_duration_sec": 1, "throttle_time_source_type": Clock()}],
            "Logging filter parameters cannot be changed between calls.",
        ),
    ):
        with pytest.raises(ValueError) as raised:
            for call in calls:
                logger.log("text", **{"severity": 20, **call})
        assert str(raised.value) == text
        # The place in the source is the same; only another logger knows nothing of it.
        logger = get_logger("texts")
    with pytest.raises(TypeError) as raised_:
        logger.info("text", throttle_time_source_type=Clock())
    assert str(raised_.value) == (
        'required parameter "throttle_duration_sec" not specified but is required for the the logging filter "throttle"'
    )


def test_callbacks_and_destroyed_nodes(node: Any) -> None:
    threshold = JumpThreshold(min_forward=None, min_backward=None)
    with pytest.raises(ValueError, match=r"^One of pre_callback or post_callback must be callable$"):
        Clock().create_jump_callback(threshold)
    with pytest.raises(ValueError, match=r"^pre_callback must be callable if given$"):
        Clock().create_jump_callback(threshold, pre_callback=1)  # type: ignore[arg-type]
    with pytest.raises(RuntimeError) as raised:
        node.create_subscription(String, "topic", lambda: None, 1)
    assert str(raised.value) == (
        "Subscription.__init__(): callback should be either be callable with one argument(to get only the message) "
        "or two (to get message and message info)"
    )
    node.destroy_node()
    with pytest.raises(InvalidHandle, match=r"^cannot use Destroyable because destruction was requested$"):
        node.get_name()
