"""Interfaces of the control graph, read from ``msg/`` and ``srv/`` where there is no ROS 2.

On ROS 2 the package that colcon builds is used instead of this one.
"""

from importlib.util import find_spec
from pathlib import Path


def _runs_embedded() -> bool:
    """Tell whether the rclpy that would be imported is rclpy_embedded, which lies beside rosidl_embedded."""
    embedded, rclpy = find_spec("rosidl_embedded"), find_spec("rclpy")
    if embedded is None or embedded.origin is None:
        return False
    if rclpy is None or rclpy.origin is None:
        return True
    return Path(rclpy.origin).parent.parent == Path(embedded.origin).parent.parent


if not _runs_embedded():
    raise ImportError(
        "fsw_msgs is not built: run 'colcon build' in the workspace and source 'install/setup.bash'"
        " (without ROS 2: install rclpy_embedded into this Python)"
    )
