"""The one main function of all nodes: start, spin, end cleanly."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args


def run(factory: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Make the node and spin it until SIGINT, SIGTERM or shutdown.

    Parameters
    ----------
    factory : callable
        Returns the node; called after ``rclpy.init``. May raise to refuse its parameters.
    args : sequence of str, optional
        Command line as ``sys.argv`` (with the program's name), the default. Only ROS arguments are accepted.

    Returns
    -------
    int
        Exit code: 0 after a clean end, 2 when an argument or a parameter is wrong (one line on stderr).
        Errors while spinning are not caught: they are bugs and deserve their traceback.
    """
    argv = list(sys.argv if args is None else args)
    node: Node | None = None
    started = False
    try:
        try:
            rclpy.init(args=argv)
            started = True
            surplus = remove_ros_args(args=argv)[1:]
            if surplus:
                raise ValueError(f"unknown arguments {' '.join(surplus)}; ROS arguments go after --ros-args")
            node = factory()
        except (KeyboardInterrupt, ExternalShutdownException):
            return 0
        except Exception as error:
            if started and not rclpy.ok():
                return 0  # told to end while still starting
            # Whatever refuses the start (rcl's argument errors are RuntimeErrors) is told in one line.
            print(f"{_program(argv)}: {_one_line(error)}", file=sys.stderr)
            return 2
        try:
            rclpy.spin(node)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        return 0
    finally:
        _end(node)


def _end(node: Node | None) -> None:
    try:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    except KeyboardInterrupt:
        # A second Ctrl-C while ending: the end is under way already.
        rclpy.try_shutdown()


def _program(argv: Sequence[str]) -> str:
    return argv[0].rsplit("/", 1)[-1] if argv else "node"


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text or type(error).__name__
