"""rclpy for machines without ROS 2: the same names and behaviour for a plain node, over Cyclone DDS.

Initialize with `init`, create nodes with `create_node` or `Node`, process callbacks with `spin`, `spin_once` or
`spin_until_future_complete`, and end with `shutdown`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rclpy.context import Context as Context
from rclpy.context import context_or_default
from rclpy.context import get_default_context as get_default_context
from rclpy.parameter import Parameter as Parameter
from rclpy.signals import SignalHandlerOptions as SignalHandlerOptions
from rclpy.signals import install_signal_handlers, uninstall_signal_handlers
from rclpy.task import Future as Future
from rclpy.utilities import get_rmw_implementation_identifier as get_rmw_implementation_identifier
from rclpy.utilities import ok as ok
from rclpy.utilities import shutdown as _shutdown
from rclpy.utilities import try_shutdown as try_shutdown

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node

__version__ = "0.2.0"

_executor: Executor | None = None


def init(
    *,
    args: list[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> None:
    """Initialize a context (default: the global one). By default only the global one gets signal handlers."""
    context = context_or_default(context)
    if signal_handler_options is None:
        is_default = context is get_default_context()
        signal_handler_options = SignalHandlerOptions.ALL if is_default else SignalHandlerOptions.NO
    context.init(args, domain_id=domain_id)
    install_signal_handlers(signal_handler_options)


def get_global_executor() -> Executor:
    global _executor
    executor = _executor
    if executor is None:
        from rclpy.executors import SingleThreadedExecutor

        executor = _executor = SingleThreadedExecutor()
        context = get_default_context()

        def reset() -> None:
            global _executor
            executor, _executor = _executor, None
            # After a signal, spin has to see that the context went down, not its executor.
            if executor is not None and not context._interrupted:
                executor.shutdown()

        context.on_shutdown(reset)
    return executor


def shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut down a context (default: the global one) and, with the global one, the signal handlers."""
    is_default = context is None or context is get_default_context()
    # Without an argument, the next init gets a new global context.
    _shutdown(context=None if is_default else context)
    if uninstall_handlers or (uninstall_handlers is None and is_default):
        uninstall_signal_handlers()


def create_node(node_name: str, **kwargs: Any) -> Node:
    """Create a node; the arguments are those of `rclpy.node.Node`."""
    from rclpy.node import Node

    return Node(node_name, **kwargs)


@contextmanager
def _holding(node: Node, executor: Executor | None, *, keep: bool = False) -> Iterator[Executor]:
    """Add a node to an executor (default: the global one) for a while; with `keep`, one that was there before stays."""
    executor = get_global_executor() if executor is None else executor
    added = executor.add_node(node)
    try:
        yield executor
    finally:
        if added or not keep:
            executor.remove_node(node)


def spin_once(node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None) -> None:
    """Wait for one callback of a node and run it, without a limit by default; with 0, only if one is ready."""
    with _holding(node, executor) as executor:
        executor.spin_once(timeout_sec=timeout_sec)


def spin(node: Node, executor: Executor | None = None) -> None:
    with _holding(node, executor) as executor:
        while executor.context.ok():
            executor.spin_once()


def spin_until_future_complete(
    node: Node, future: Future, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Run the callbacks of a node until a future is done, the time is over or the context is shut down."""
    with _holding(node, executor, keep=True) as executor:
        executor.spin_until_future_complete(future, timeout_sec)
