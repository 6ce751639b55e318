"""QoS that can be overridden by parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.duration import Duration
from rclpy.exceptions import ParameterAlreadyDeclaredException
from rclpy.qos import QoSPolicyEnum, QoSPolicyKind, QoSProfile

if TYPE_CHECKING:
    from rclpy.node import Node


class InvalidQosOverridesError(Exception):
    """Raised when the callback refuses the profile that results from the overrides."""


QosCallbackResult = SetParametersResult
QosCallbackType = Callable[[QoSProfile], QosCallbackResult]


class QoSOverridingOptions:
    """Which policies of an entity can be overridden by read-only parameters.

    Parameters
    ----------
    policy_kinds : iterable of QoSPolicyKind
        A parameter is declared for each.
    callback : callable, optional
        Takes the resulting profile and returns a SetParametersResult.
    entity_id : str, optional
        Tells entities on the same topic apart.
    """

    def __init__(
        self,
        policy_kinds: Iterable[QoSPolicyKind],
        *,
        callback: QosCallbackType | None = None,
        entity_id: str | None = None,
    ) -> None:
        self.policy_kinds = policy_kinds
        self.callback = callback
        self.entity_id = entity_id

    @classmethod
    def with_default_policies(
        cls, *, callback: QosCallbackType | None = None, entity_id: str | None = None
    ) -> QoSOverridingOptions:
        """Return options for history, depth and reliability."""
        kinds = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
        return cls(kinds, callback=callback, entity_id=entity_id)


def _declare_qos_parameters(
    entity_type: type, node: Node, topic_name: str, qos: QoSProfile, options: QoSOverridingOptions
) -> None:
    """Declare the parameters of a publisher or subscription and put their values into `qos`.

    Raises
    ------
    InvalidQosOverridesError
        If the callback refuses the result.
    TypeError
        If `entity_type` is neither a publisher nor a subscription.
    """
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

    if not issubclass(entity_type, (Publisher, Subscription)):
        raise TypeError("Argument `entity_type` should be a subclass of Publisher or Subscription")
    entity = "publisher" if issubclass(entity_type, Publisher) else "subscription"
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    about = f"for {entity} `{topic_name}` with id `{options.entity_id}`"
    for policy in options.policy_kinds:
        if policy is QoSPolicyKind.LIFESPAN and entity == "subscription":
            continue
        field = policy.name.lower()
        name = f"qos_overrides.{topic_name}.{entity}{suffix}.{field}"
        descriptor = ParameterDescriptor(description=f"{field} {about}", read_only=True)
        try:
            parameter = node.declare_parameter(name, _get_qos_policy_parameter(qos, policy), descriptor)
        except ParameterAlreadyDeclaredException:
            parameter = node.get_parameter(name)
        _override_qos_policy(qos, field, parameter.value)
    if options.callback is not None and not (result := options.callback(qos)).successful:
        raise InvalidQosOverridesError(f"Provided QoS overrides {about}, are not valid: {result.reason}")


def _get_qos_policy_parameter(qos: QoSProfile, policy: QoSPolicyKind) -> str | int | bool:
    """Return a policy as a parameter's value: enums by name, durations in nanoseconds."""
    value = getattr(qos, policy.name.lower())
    if isinstance(value, Duration):
        return value.nanoseconds
    if not isinstance(value, QoSPolicyEnum):
        return value
    if value.short_key == "unknown":
        raise ValueError("User provided QoS profile is invalid")
    return value.short_key


def _override_qos_policy(qos: QoSProfile, field: str, value: Any) -> None:
    current = getattr(qos, field)
    if isinstance(current, Duration):
        value = Duration(nanoseconds=value)
    elif isinstance(current, QoSPolicyEnum):
        try:
            value = type(current)[value.upper()]
        except KeyError:
            raise RuntimeError(f"Unexpected QoS override for policy `{field}`: `{value}`") from None
    setattr(qos, field, value)
