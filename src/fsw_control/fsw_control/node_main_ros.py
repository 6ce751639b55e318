"""The main function of all nodes: start, spin, shut down cleanly."""

from __future__ import annotations

import atexit
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.utilities import get_default_context, remove_ros_args

from fsw_control.light_node_ros import ends_in_time, join
from fsw_control.node_arguments import NodeArguments, asks_for_help
from fsw_control.parameters import NodeParameters

#: A signal this long after the first one counts as a second request.
_PATIENCE_S = 1.0


class _Interrupts:
    """Handler of SIGINT and SIGTERM that replaces rclpy's.

    Rclpy's handler shuts ROS down in the middle of a callback: what the callback publishes after
    that is dropped silently, and what it published before may not arrive. Here the callback ends
    first, and then the node.

    While the node starts, KeyboardInterrupt ends it at once. While it spins, only a second, later
    signal interrupts a callback that does not return. During shutdown signals are ignored: a
    Ctrl-C often comes twice, from the terminal and from launch, and must not truncate a bag.
    """

    def __init__(self) -> None:
        self.phase = "starting"
        self._first_s: float | None = None
        self._before: dict[signal.Signals, Any] = {}

    @property
    def asked(self) -> bool:
        """Whether a signal has arrived."""
        return self._first_s is not None

    def __enter__(self) -> _Interrupts:
        if threading.current_thread() is threading.main_thread():
            for sign in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(sign) in (signal.default_int_handler, signal.SIG_DFL):
                    self._before[sign] = signal.signal(sign, self)
        return self

    def __exit__(self, *_: object) -> None:
        for sign, handler in self._before.items():
            # Once interrupted, the process ends; ignore another Ctrl-C until the line below takes
            # effect.
            signal.signal(sign, signal.SIG_IGN if self.asked else handler)
            # A second signal during interpreter shutdown must not change the exit code.
            atexit.register(signal.signal, sign, signal.SIG_IGN)

    def __call__(self, *_: object) -> None:
        now_s = time.monotonic()
        if self._first_s is None:
            self._first_s = now_s
        is_second = self.phase == "spinning" and now_s - self._first_s > _PATIENCE_S
        if self.phase == "starting" or is_second:
            self.phase = "ending"
            raise KeyboardInterrupt


def _spin(node: Node, interrupts: _Interrupts) -> None:
    """Spin until a signal or shutdown.

    Rclpy raises a RuntimeError out of the service's callback if a managed node is asked for a
    transition that its state does not allow; the spin continues.
    """
    executor = rclpy.get_global_executor()
    executor.add_node(node)
    while rclpy.ok() and not interrupts.asked:
        try:
            executor.spin_once()
        except RuntimeError as error:
            if not isinstance(node, LifecycleNode) or "transition" not in str(error):
                raise
            node.get_logger().warning(f"refused: {' '.join(str(error).split())}")


def run(
    factory: Callable[..., Node],
    args: Sequence[str] | None = None,
    arguments: NodeArguments | None = None,
) -> int:
    """Create the node and spin it until SIGINT, SIGTERM or shutdown.

    Parameters
    ----------
    factory : callable
        Returns the node, a ``LightNode``; called after ``rclpy.init``, with the positional
        argument before ``--ros-args`` if there is one. May raise to reject its parameters.
    args : sequence of str, optional
        Command line as in ``sys.argv`` (with the program's name), its default. Only ROS arguments
        are accepted, and one positional argument if ``arguments`` names it (``positional``).
    arguments : NodeArguments, optional
        The accepted ones, for ``--help`` and to reject unknown parameters.

    Returns
    -------
    int
        Exit code: 0 after a clean end, 2 if an argument or a parameter is wrong (one line on
        stderr). Errors while spinning are bugs and keep their traceback, unless ROS was shut down
        meanwhile.
    """
    argv = list(sys.argv if args is None else args)
    node: Node | None = None
    started = False
    program = argv[0].rsplit("/", 1)[-1] if argv else "node"
    if arguments is not None and asks_for_help(argv):
        print(arguments.help(program))
        return 0
    with _Interrupts() as interrupts:
        try:
            if arguments is not None:
                arguments.check(argv)  # before ROS opens the files: it would block on a pipe
            join(argv)
            started = True
            words = remove_ros_args(args=argv)[1:]
            taken = 1 if arguments is not None and arguments.positional else 0
            if surplus := words[taken:] or [word for word in words if word.startswith("-")]:
                text = f"unknown arguments {' '.join(surplus)}"
                raise ValueError(f"{text}; ROS arguments go after --ros-args")
            node = factory(*words)
            interrupts.phase = "spinning"
            _spin(node, interrupts)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        except Exception as error:
            # After a shutdown, while starting or in a callback, rclpy raises various exceptions.
            if not started or rclpy.ok():
                if node is not None:
                    raise
                # Any error during the start (rcl's argument errors are RuntimeErrors) is reported
                # in one line.
                text = " ".join(str(error).split()) or type(error).__name__
                print(f"{program}: {text}", file=sys.stderr)
                return 2
        finally:
            interrupts.phase = "ending"
            if node is not None:
                node.destroy_node()
            _leave_graph()
    return 0


def _leave_graph() -> None:
    context = get_default_context()
    with ends_in_time():
        rclpy.try_shutdown()
        # A node whose start failed half-way cannot be destroyed; it still leaves the graph here.
        context.destroy()


def main_of(
    node: Callable[..., Node], name: str, about: str | None, parameters: type[NodeParameters]
) -> Callable[..., int]:
    """Return the ``main`` of a node's module.

    Its argument is the command line (None: ``sys.argv``), its result the exit code of :func:`run`.
    """

    def main(args: Sequence[str] | None = None) -> int:
        return run(node, args, NodeArguments(name, about or "", parameters))

    return main
