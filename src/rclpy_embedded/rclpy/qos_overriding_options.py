"""QoS that can be overridden by parameters, when an entity is created with options for it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from rclpy import qos as qos_module
from rclpy.duration import Duration
from rclpy.exceptions import ParameterAlreadyDeclaredException
from rclpy.qos import QoSPolicyKind, QoSProfile

if TYPE_CHECKING:
    from rclpy.node import Node


class InvalidQosOverridesError(Exception):
    """Raised when the callback of the options refuses the result."""


class QoSOverridingOptions:
    """Which policies get a parameter, how the result is checked, and an id if a node has several such entities."""

    def __init__(
        self,
        policy_kinds: Iterable[QoSPolicyKind],
        *,
        callback: Callable[[QoSProfile], Any] | None = None,
        entity_id: str | None = None,
    ) -> None:
        self.policy_kinds = policy_kinds
        self.callback = callback
        self.entity_id = entity_id

    @classmethod
    def with_default_policies(
        cls, *, callback: Callable[[QoSProfile], Any] | None = None, entity_id: str | None = None
    ) -> QoSOverridingOptions:
        """Return options for history, depth and reliability."""
        kinds = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
        return cls(kinds, callback=callback, entity_id=entity_id)


def declare_qos_parameters(
    entity: str, node: Node, topic_name: str, profile: QoSProfile, options: QoSOverridingOptions
) -> QoSProfile:
    """Declare the parameters ``qos_overrides.<topic>.<entity>.<policy>`` and return the profile they give.

    Raises
    ------
    InvalidQosOverridesError
        If the callback of the options refuses the profile.
    """
    from rcl_interfaces.msg import ParameterDescriptor

    profile = copy.copy(profile)
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    where = f"for {entity} `{topic_name}` with id `{options.entity_id}`"
    for kind in options.policy_kinds:
        policy = kind.name.lower()
        if entity == "subscription" and kind is QoSPolicyKind.LIFESPAN:
            continue
        name = f"qos_overrides.{topic_name}.{entity}{suffix}.{policy}"
        default = getattr(profile, policy)
        if isinstance(default, Duration):
            value: Any = default.nanoseconds
        elif isinstance(default, IntEnum):
            value = default.name.lower()
        else:
            value = default
        if value == "unknown":
            raise ValueError("User provided QoS profile is invalid")
        try:
            descriptor = ParameterDescriptor(description=f"{policy} {where}", read_only=True)
            value = node.declare_parameter(name, value, descriptor).value
        except ParameterAlreadyDeclaredException:
            value = node.get_parameter(name).value
        if isinstance(default, Duration):
            value = Duration(nanoseconds=value)
        elif isinstance(default, IntEnum):
            try:
                value = getattr(qos_module, type(default).__name__)[value.upper()]
            except KeyError:
                raise RuntimeError(f"Unexpected QoS override for policy `{policy}`: `{value}`") from None
        setattr(profile, policy, value)
    if options.callback is not None:
        result = options.callback(profile)
        if not result.successful:
            raise InvalidQosOverridesError(f"Provided QoS overrides {where}, are not valid: {result.reason}")
    return profile
