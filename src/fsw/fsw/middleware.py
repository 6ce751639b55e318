"""Whether ROS 2 is installed; without it welds run in one process and there is no graph."""

from __future__ import annotations

from importlib.util import find_spec

#: documentation of its installation
HOW = "see docs/how-to/install.md"


def middleware_is_here() -> bool:
    """Whether rclpy and this project's messages are installed."""
    return (
        all(find_spec(name) is not None for name in ("rclpy", "fsw_msgs"))
        and find_spec("fsw_msgs.msg") is not None
    )
