"""QoS that can be overridden by parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.msg import SetParametersResult as QosCallbackResult
from rclpy.duration import Duration
from rclpy.exceptions import ParameterAlreadyDeclaredException
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyEnum, QoSPolicyKind, QoSProfile
from rclpy.subscription import Subscription

QosCallbackType = Callable[[QoSProfile], QosCallbackResult]


class InvalidQosOverridesError(Exception):
    """The callback refuses the profile that results from the overrides."""


@dataclass
class QoSOverridingOptions:
    """Which policies of an entity can be overridden by read-only parameters.

    The callback checks the resulting profile; `entity_id` tells entities on the same topic apart.
    """

    policy_kinds: Iterable[QoSPolicyKind]
    callback: QosCallbackType | None = None
    entity_id: str | None = None

    @classmethod
    def with_default_policies(
        cls, *, callback: QosCallbackType | None = None, entity_id: str | None = None
    ) -> QoSOverridingOptions:
        """Return options for history, depth and reliability."""
        kinds = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
        return cls(kinds, callback=callback, entity_id=entity_id)


def _declare_qos_parameters(
    entity_type: type[Publisher | Subscription],
    node: Any,
    topic_name: str,
    qos: QoSProfile,
    options: QoSOverridingOptions,
) -> None:
    """Declare ``qos_overrides.<topic>.<entity>.<policy>`` and change the profile to what the parameters give."""
    entity = "publisher" if issubclass(entity_type, Publisher) else "subscription"
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    about = f"for {entity} `{topic_name}` with id `{options.entity_id}`"
    for kind in options.policy_kinds:
        if entity == "subscription" and kind is QoSPolicyKind.LIFESPAN:
            continue
        policy = kind.name.lower()
        name = f"qos_overrides.{topic_name}.{entity}{suffix}.{policy}"
        descriptor = ParameterDescriptor(description=f"{policy} {about}", read_only=True)
        try:
            parameter = node.declare_parameter(name, _get_qos_policy_parameter(qos, kind), descriptor)
        except ParameterAlreadyDeclaredException:
            parameter = node.get_parameter(name)
        _set_policy(qos, policy, parameter.value)
    if options.callback is not None and not (result := options.callback(qos)).successful:
        raise InvalidQosOverridesError(f"Provided QoS overrides {about}, are not valid: {result.reason}")


def _get_qos_policy_parameter(qos: QoSProfile, policy: QoSPolicyKind) -> str | int | bool:
    """Return a policy as a parameter's value: enums by name, durations in nanoseconds."""
    value: str | int | bool | Duration = getattr(qos, policy.name.lower())
    if isinstance(value, Duration):
        return value.nanoseconds
    if not isinstance(value, QoSPolicyEnum):
        return value
    if value.short_key == "unknown":
        raise ValueError("User provided QoS profile is invalid")
    return value.short_key


def _set_policy(profile: QoSProfile, policy: str, value: Any) -> None:
    current = getattr(profile, policy)
    if isinstance(current, Duration):
        value = Duration(nanoseconds=value)
    elif isinstance(current, QoSPolicyEnum):
        try:
            value = type(current)[value.upper()]
        except KeyError:
            raise RuntimeError(f"Unexpected QoS override for policy `{policy}`: `{value}`") from None
    setattr(profile, policy, value)
