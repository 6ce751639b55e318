"""QoS that can be overridden by parameters."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.msg import SetParametersResult as QosCallbackResult
from rclpy.duration import Duration
from rclpy.exceptions import ParameterAlreadyDeclaredException
from rclpy.qos import QoSPolicyEnum, QoSPolicyKind, QoSProfile

if TYPE_CHECKING:
    from rclpy.node import Node


class InvalidQosOverridesError(Exception):
    """Raised when the callback refuses the profile that results from the overrides."""


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


def declare_qos_parameters(
    entity: str, node: Node, topic_name: str, profile: QoSProfile, options: QoSOverridingOptions
) -> QoSProfile:
    """Declare ``qos_overrides.<topic>.<entity>.<policy>`` and return the profile that the parameters give.

    `entity` is 'publisher' or 'subscription'.

    Raises
    ------
    InvalidQosOverridesError
        If the callback of the options refuses the profile.
    """
    profile = copy.copy(profile)
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    about = f"for {entity} `{topic_name}` with id `{options.entity_id}`"
    for kind in options.policy_kinds:
        if entity == "subscription" and kind is QoSPolicyKind.LIFESPAN:
            continue
        policy = kind.name.lower()
        name = f"qos_overrides.{topic_name}.{entity}{suffix}.{policy}"
        descriptor = ParameterDescriptor(description=f"{policy} {about}", read_only=True)
        try:
            parameter = node.declare_parameter(name, _get_qos_policy_parameter(profile, kind), descriptor)
        except ParameterAlreadyDeclaredException:
            parameter = node.get_parameter(name)
        _set_policy(profile, policy, parameter.value)
    if options.callback is not None and not (result := options.callback(profile)).successful:
        raise InvalidQosOverridesError(f"Provided QoS overrides {about}, are not valid: {result.reason}")
    return profile


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
    """Set a policy from a parameter's value; RuntimeError if there is no such policy."""
    current = getattr(profile, policy)
    if isinstance(current, Duration):
        value = Duration(nanoseconds=value)
    elif isinstance(current, QoSPolicyEnum):
        try:
            value = type(current)[value.upper()]
        except KeyError:
            raise RuntimeError(f"Unexpected QoS override for policy `{policy}`: `{value}`") from None
    setattr(profile, policy, value)


def _declare_qos_parameters(
    entity_type: type, node: Node, topic_name: str, qos: QoSProfile, options: QoSOverridingOptions
) -> None:
    """Do the same under the genuine, private name, which takes a class and changes `qos` itself."""
    profile = declare_qos_parameters(entity_type.__name__.lower(), node, topic_name, qos, options)
    for policy, value in profile.to_dict().items():
        setattr(qos, policy, value)
