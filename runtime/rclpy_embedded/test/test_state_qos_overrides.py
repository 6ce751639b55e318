"""Parameters that override the QoS of an entity."""

import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.parameter_store import ParameterStore
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy, qos_profile_unknown
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions, declare_qos_parameters


def overridden(**values: object) -> ParameterStore:
    names = {f"qos_overrides./t.publisher.{policy}": value for policy, value in values.items()}
    return ParameterStore({name: Parameter(name, value=value) for name, value in names.items()})


def test_parameters_are_declared_and_override() -> None:
    node, asked = overridden(depth=100, reliability="best_effort"), QoSProfile(depth=10)
    for _ in range(2):  # the second entity on the topic finds them declared
        profile = declare_qos_parameters("publisher", node, "/t", asked, QoSOverridingOptions.with_default_policies())
        assert profile == QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    assert asked == QoSProfile(depth=10)
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
    assert declare_qos_parameters("subscription", node, "/t", asked, options) == asked
    assert list(node.get_parameters_by_prefix("qos_overrides./t.subscription_x")) == ["deadline"]
    assert node.get_parameter("qos_overrides./t.subscription_x.deadline").value == 2 * 10**9


def test_bad_overrides_are_refused() -> None:
    options = QoSOverridingOptions.with_default_policies(
        callback=lambda profile: SetParametersResult(successful=profile.depth < 5, reason="too deep")
    )
    assert declare_qos_parameters("publisher", overridden(), "/t", QoSProfile(depth=1), options).depth == 1
    with pytest.raises(InvalidQosOverridesError, match="too deep"):
        declare_qos_parameters("publisher", overridden(depth=7), "/t", QoSProfile(depth=1), options)
    with pytest.raises(RuntimeError, match="Unexpected QoS override for policy `reliability`: `sure`"):
        declare_qos_parameters("publisher", overridden(reliability="sure"), "/t", QoSProfile(depth=1), options)
    with pytest.raises(ValueError, match="User provided QoS profile is invalid"):
        declare_qos_parameters("publisher", overridden(), "/t", qos_profile_unknown, options)
