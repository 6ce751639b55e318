"""Actions between processes, one of which may die."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient, ActionServer, CancelResponse

PATIENCE_S = 240.0

SERVER = """
import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionServer, CancelResponse
from rclpy.executors import ExternalShutdownException
rclpy.init()
node = rclpy.create_node("server")
async def execute(goal_handle):
    done = rclpy.Future()
    def step():
        goal_handle.publish_feedback(Fibonacci.Feedback(sequence=[goal_handle.request.order]))
        if goal_handle.is_cancel_requested and not done.done():
            done.set_result(None)
    timer = node.create_timer(0.02, step)
    print("executing", flush=True)
    await done
    node.destroy_timer(timer)
    goal_handle.canceled()
    return Fibonacci.Result(sequence=[1, 2, 3])
ActionServer(node, Fibonacci, "fibonacci", execute, cancel_callback=lambda _: CancelResponse.ACCEPT)
print("ready", flush=True)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""

CLIENT = """
import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient
rclpy.init()
node = rclpy.create_node("client")
client = ActionClient(node, Fibonacci, "fibonacci")
client.wait_for_server()
sent = client.send_goal_async(Fibonacci.Goal(order=5))
rclpy.spin_until_future_complete(node, sent)
result = sent.result().get_result_async()
print("accepted", sent.result().accepted, flush=True)
rclpy.spin_until_future_complete(node, result)
print(result.result().status, list(result.result().result.sequence), flush=True)
"""


def test_feedback_and_cancellation_across_processes(node: Any, spinner: Any, run_program: Callable[..., Any]) -> None:
    server = run_program(SERVER)
    assert server.line() == "ready"
    client = ActionClient(node, Fibonacci, "fibonacci")
    assert client.wait_for_server(PATIENCE_S)
    feedback: list[int] = []
    sent = client.send_goal_async(
        Fibonacci.Goal(order=9), feedback_callback=lambda m: feedback.append(m.feedback.sequence[0])
    )
    assert spinner.until(sent.done)
    assert spinner.until(lambda: len(feedback) >= 3)
    assert set(feedback) == {9}
    result = sent.result().get_result_async()
    cancel = sent.result().cancel_goal_async()
    assert spinner.until(result.done)
    assert cancel.done()
    assert len(cancel.result().goals_canceling) == 1
    assert (result.result().status, list(result.result().result.sequence)) == (GoalStatus.STATUS_CANCELED, [1, 2, 3])


@pytest.mark.full
def test_the_server_dies(
    node: Any, spinner: Any, run_program: Callable[..., Any], wait_until: Callable[..., bool]
) -> None:
    server = run_program(SERVER)
    assert server.line() == "ready"
    client = ActionClient(node, Fibonacci, "fibonacci")
    assert client.wait_for_server(PATIENCE_S)
    sent = client.send_goal_async(Fibonacci.Goal(order=9))
    assert spinner.until(sent.done)
    result = sent.result().get_result_async()
    assert server.line() == "executing"
    server.process.kill()
    assert wait_until(lambda: not client.server_is_ready())
    spinner.rest()
    assert not result.done()
    run_program(SERVER)
    assert client.wait_for_server(PATIENCE_S)
    again = sent.result().get_result_async()
    assert spinner.until(again.done)
    assert again.result().status == GoalStatus.STATUS_UNKNOWN  # the new server never heard of it


def test_a_client_dies_and_another_gets_served(node: Any, spinner: Any, run_program: Callable[..., Any]) -> None:
    goals: list[Any] = []

    async def execute(goal_handle: Any) -> Any:
        goals.append(goal_handle)
        if len(goals) == 1:
            while first.process.poll() is None:
                await wake()
        goal_handle.succeed()
        return Fibonacci.Result(sequence=[len(goals)])

    async def wake() -> None:
        from rclpy.task import Future

        future = Future()
        timer = node.create_timer(0.01, lambda: future.set_result(None))
        await future
        node.destroy_timer(timer)

    ActionServer(node, Fibonacci, "fibonacci", execute, cancel_callback=lambda _: CancelResponse.ACCEPT)
    first = run_program(CLIENT)
    assert spinner.until(lambda: goals)
    assert first.line() == "accepted True"
    spinner.rest()
    first.process.kill()
    assert spinner.until(lambda: not goals[0].is_active)
    second = run_program(CLIENT)
    assert spinner.until(lambda: second.process.poll() is not None)
    code, out, err = second.finish()
    assert (code, out.splitlines()) == (0, ["accepted True", "4 [2]"]), err
