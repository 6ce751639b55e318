"""Checks that a class is a message, a service or an action."""

from typing import Any

from rclpy.exceptions import NoTypeSupportImportedException


def check_for_type_support(msg_or_srv_type: Any) -> None:
    """Raise NoTypeSupportImportedException if a generated class has no type support, AttributeError for others."""
    if not hasattr(msg_or_srv_type, "_TYPE_NAME"):
        if hasattr(msg_or_srv_type, "__import_type_support__"):
            raise NoTypeSupportImportedException
        raise AttributeError(f"{msg_or_srv_type!r} is no class of messages or services")


def check_is_valid_msg_type(msg_type: Any) -> None:
    """Raise RuntimeError if `msg_type` is a service, AttributeError if it is neither that nor a message."""
    _check(msg_type, "message", "__slots__", "this might be a service or action")


def check_is_valid_srv_type(srv_type: Any) -> None:
    """Raise RuntimeError if `srv_type` is a message, AttributeError if it is neither that nor a service."""
    _check(srv_type, "service", "Request", "this might be a message or action")


def check_is_valid_action_type(action_type: Any) -> None:
    """Raise RuntimeError if `action_type` is a message or a service, AttributeError if it is none of these."""
    _check(action_type, "action", "Impl", "this might be a message or service")


def _check(cls: Any, kind: str, attribute: str, hint: str) -> None:
    if not hasattr(cls, "_TYPE_NAME"):
        raise AttributeError(
            f"{cls!r} is not a {kind} class of ROS 2. This might be a ROS 1 message type but it should be a ROS 2 "
            "message type. Make sure to source your ROS 2 workspace after your ROS 1 workspace."
        )
    if not hasattr(cls, attribute):
        raise RuntimeError(f"The {kind} type provided is not valid ({cls}), {hint}")
