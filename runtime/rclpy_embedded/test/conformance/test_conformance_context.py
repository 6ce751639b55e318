"""Init, shutdown, several contexts, domains, the command line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.context import Context
from rclpy.exceptions import NotInitializedException
from rclpy.utilities import get_default_context, remove_ros_args, timeout_sec_to_nsec
from std_msgs.msg import Empty
from std_srvs.srv import Empty as EmptySrv


def test_init_ok_shutdown(domain_id: int) -> None:
    assert not rclpy.ok()
    rclpy.init(args=[])
    try:
        assert rclpy.ok()
        assert get_default_context().get_domain_id() == domain_id
    finally:
        rclpy.shutdown()
    assert not rclpy.ok()


def test_init_again_after_shutdown(domain_id: int) -> None:
    for _ in range(3):
        rclpy.init(args=[])
        node = rclpy.create_node("again")
        assert node.get_name() == "again"
        node.destroy_node()
        rclpy.shutdown()


def test_double_init(context: Context) -> None:
    with pytest.raises(RuntimeError, match="only be called once"):
        context.init()


def test_double_init_of_default_context(domain_id: int) -> None:
    rclpy.init(args=[])
    try:
        with pytest.raises(RuntimeError):
            rclpy.init(args=[])
    finally:
        rclpy.shutdown()


def test_shutdown_without_init() -> None:
    with pytest.raises(RuntimeError, match="initialized"):
        rclpy.shutdown()
    rclpy.try_shutdown()


def test_shutdown_twice(context: Context) -> None:
    context.shutdown()
    with pytest.raises(RCLError, match="already"):
        context.shutdown()
    context.try_shutdown()


def test_node_needs_init() -> None:
    with pytest.raises(NotInitializedException):
        rclpy.create_node("early", context=Context())


def test_node_needs_context_that_is_up(context: Context) -> None:
    context.shutdown()
    with pytest.raises(NotInitializedException):
        rclpy.create_node("late", context=context)


def test_bad_domain() -> None:
    with pytest.raises(RuntimeError, match="lower than zero"):
        Context().init(args=[], domain_id=-1)


def test_on_shutdown(context: Context) -> None:
    calls: list[str] = []

    class Listener:
        def stop(self) -> None:
            calls.append("method")

    kept, dropped = Listener(), Listener()
    context.on_shutdown(lambda: calls.append("function"))
    context.on_shutdown(kept.stop)
    context.on_shutdown(dropped.stop)
    del dropped
    context.shutdown()
    assert calls == ["function", "method"]
    context.on_shutdown(lambda: calls.append("late"))
    assert calls[-1] == "late"
    with pytest.raises(TypeError):
        context.on_shutdown("nothing")  # type: ignore[arg-type]


def test_contexts_are_isolated(context: Context, domain_id: int, wait_until: Any) -> None:
    with Context() as other:
        assert other.ok()
        node = rclpy.create_node("elsewhere", context=other)
        context.shutdown()
        assert other.ok()
        assert wait_until(lambda: node.count_publishers("/rosout") >= 1)
        node.destroy_node()
    assert not other.ok()


def test_after_shutdown(context: Context) -> None:
    node = rclpy.create_node("late", context=context)
    publisher = node.create_publisher(Empty, "late", 1)
    client = node.create_client(EmptySrv, "late")
    context.shutdown()
    for use in (
        lambda: publisher.publish(Empty()),
        publisher.get_subscription_count,
        publisher.wait_for_all_acked,
        publisher.assert_liveliness,
        client.service_is_ready,
        lambda: client.wait_for_service(0.1),
        node.get_topic_names_and_types,
        node.get_node_names,
        lambda: node.count_publishers("late"),
        lambda: node.create_publisher(Empty, "later", 1),
        lambda: node.create_service(EmptySrv, "later", lambda request, response: response),
        lambda: node.create_timer(1, lambda: None),
        lambda: node.create_guard_condition(lambda: None),
        lambda: node.declare_parameter("gain", 1.0),
    ):
        with pytest.raises(RCLError, match="context"):
            use()
    assert node.get_name() == "late"
    node.get_logger().info("a last word")
    node.destroy_node()


def test_command_line_applies_to_nodes(domain_id: int) -> None:
    context = Context()
    context.init(args=["prog", "--ros-args", "-r", "__ns:=/plant", "-r", "depth:=/fsw/depth", "-p", "gain:=2.5"])
    try:
        node = rclpy.create_node("sensor", context=context)
        assert node.get_fully_qualified_name() == "/plant/sensor"
        assert node.resolve_topic_name("depth") == "/fsw/depth"
        assert node.declare_parameter("gain", 1.0).value == 2.5
        deaf = rclpy.create_node(
            "deaf", context=context, use_global_arguments=False, cli_args=["--ros-args", "-p", "gain:=3.5"]
        )
        assert deaf.get_namespace() == "/"
        assert deaf.declare_parameter("gain", 1.0).value == 3.5
    finally:
        context.destroy()


def test_remove_ros_args() -> None:
    assert remove_ros_args(["prog", "-v", "--ros-args", "-p", "a:=1", "--", "file"]) == ["prog", "-v", "file"]


def test_timeout_sec_to_nsec() -> None:
    assert timeout_sec_to_nsec(None) == -1
    assert timeout_sec_to_nsec(-1) == -1
    assert timeout_sec_to_nsec(1.5) == 1_500_000_000


def test_default_context_is_new_after_shutdown(domain_id: int) -> None:
    first = get_default_context()
    rclpy.init(args=[])
    rclpy.shutdown()
    assert get_default_context() is not first
    with pytest.raises(RuntimeError):
        first.init(args=[])


def test_node_arguments_are_a_command_line(context: Context) -> None:
    node = rclpy.create_node("plain", context=context, cli_args=["plain", "words", "--ros-args", "-r", "__node:=named"])
    assert node.get_name() == "named"
    node.destroy_node()
    with pytest.raises(UnknownROSArgsError):
        rclpy.create_node("plain", context=context, cli_args=["--ros-args", "--nonsense"])


@pytest.mark.parametrize("module", ["rclpy", "rclpy.node", "rclpy.executors"])
def test_interfaces_can_be_imported_after(module: str, run_program: Callable[..., Any]) -> None:
    code, _, errors = run_program(f"import {module}\nfrom std_msgs.msg import String\nString(data='x')").finish()
    assert code == 0, errors
