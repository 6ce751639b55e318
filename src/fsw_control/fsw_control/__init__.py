"""Contract between plant, controllers and supervisor, and the node that hosts any controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fsw_control.contract import (
    Command,
    Controller,
    Diagnosis,
    Limits,
    Measurement,
    Plan,
    Proposal,
    Reference,
)
from fsw_control.sensors import SENSORS

if TYPE_CHECKING:
    from fsw_control.controller_node import ControllerNode as ControllerNode
    from fsw_control.controller_node import run_controller as run_controller

__all__ = [
    "SENSORS",
    "Command",
    "Controller",
    "Diagnosis",
    "Limits",
    "Measurement",
    "Plan",
    "Proposal",
    "Reference",
]


def __getattr__(name: str) -> Any:
    # The node needs rclpy, which the core must do without: it is imported at first use.
    if name in ("ControllerNode", "run_controller"):
        from fsw_control import controller_node

        return getattr(controller_node, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
