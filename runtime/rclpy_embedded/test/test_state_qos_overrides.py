"""Parameters that override the QoS of an entity."""

import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.parameter_store import ParameterStore
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy, qos_profile_unknown
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions, _declare_qos_parameters
from rclpy.subscription import Subscription


def overridden(**values: object) -> ParameterStore:
    names = {f"qos_overrides./t.publisher.{policy}": value for policy, value in values.items()}
    return ParameterStore({name: Parameter(name, value=value) for name, value in names.items()})


def declared(kind: type, node: ParameterStore, asked: QoSProfile, options: QoSOverridingOptions) -> QoSProfile:
    profile = asked.get_c_qos_profile()
    _declare_qos_parameters(kind, node, "/t", profile, options)
    return profile


def test_parameters_are_declared_and_override() -> None:
    node, asked = overridden(depth=100, reliability="best_effort"), QoSProfile(depth=10)
    for _ in range(2):  # the second entity on the topic finds them declared
        profile = declared(Publisher, node, asked, QoSOverridingOptions.with_default_policies())
        assert profile == QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    found = {name: parameter.value for name, parameter in node.get_parameters_by_prefix("qos_overrides").items()}
    assert found == {
        "/t.publisher.history": "keep_last",
        "/t.publisher.depth": 100,
        "/t.publisher.reliability": "best_effort",
    }
    assert node.describe_parameter("qos_overrides./t.publisher.depth").read_only


def test_durations_ids_and_lifespan() -> None:
    node, options = overridden(), QoSOverridingOptions([QoSPolicyKind.DEADLINE, QoSPolicyKind.LIFESPAN], entity_id="x")
    asked = QoSProfile(depth=1, deadline=Duration(seconds=2))
    assert declared(Subscription, node, asked, options) == asked
    assert list(node.get_parameters_by_prefix("qos_overrides./t.subscription_x")) == ["deadline"]
    assert node.get_parameter("qos_overrides./t.subscription_x.deadline").value == 2 * 10**9


def test_bad_overrides_are_refused() -> None:
    options = QoSOverridingOptions.with_default_policies(
        callback=lambda profile: SetParametersResult(successful=profile.depth < 5, reason="too deep")
    )
    assert declared(Publisher, overridden(), QoSProfile(depth=1), options).depth == 1
    with pytest.raises(InvalidQosOverridesError, match="too deep"):
        declared(Publisher, overridden(depth=7), QoSProfile(depth=1), options)
    with pytest.raises(RuntimeError, match="Unexpected QoS override for policy `reliability`: `sure`"):
        declared(Publisher, overridden(reliability="sure"), QoSProfile(depth=1), options)
    with pytest.raises(ValueError, match="User provided QoS profile is invalid"):
        declared(Publisher, overridden(), qos_profile_unknown, options)
