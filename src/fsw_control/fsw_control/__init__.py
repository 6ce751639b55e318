"""Contract between plant, controllers and supervisor, and the node that hosts any controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fsw_control.contract import Command as Command
from fsw_control.contract import Controller as Controller
from fsw_control.contract import Diagnosis as Diagnosis
from fsw_control.contract import Limits as Limits
from fsw_control.contract import Measurement as Measurement
from fsw_control.contract import Plan as Plan
from fsw_control.contract import Proposal as Proposal
from fsw_control.contract import Reference as Reference
from fsw_control.sensors import SENSORS as SENSORS

if TYPE_CHECKING:
    from fsw_control.controller_node import ControllerNode as ControllerNode
    from fsw_control.controller_node import run_controller as run_controller


def __getattr__(name: str) -> Any:
    # The node needs rclpy, which the core must do without: it is imported at first use.
    if name in ("ControllerNode", "run_controller"):
        from fsw_control import controller_node

        return getattr(controller_node, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
