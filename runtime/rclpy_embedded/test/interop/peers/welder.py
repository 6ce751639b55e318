"""A managed node ``/far/welder`` with the action ``/far/weld``, which counts up and can be canceled."""

import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from spinning import spin
from std_msgs.msg import String


class Welder(LifecycleNode):
    def on_configure(self, state):
        self.texts = self.create_lifecycle_publisher(String, "texts", 10)
        return super().on_configure(state)

    def on_deactivate(self, state):
        return TransitionCallbackReturn.FAILURE

    def on_shutdown(self, state):
        return TransitionCallbackReturn.ERROR


async def weld(goal_handle):
    """Count up to the order at 50 Hz; a negative order goes on until it is canceled."""
    numbers, done = [], rclpy.Future()

    def step():
        numbers.append(len(numbers))
        goal_handle.publish_feedback(Fibonacci.Feedback(sequence=numbers))
        if not done.done() and (goal_handle.is_cancel_requested or len(numbers) == goal_handle.request.order):
            done.set_result(None)

    timer = node.create_timer(0.02, step)
    await done
    node.destroy_timer(timer)
    if goal_handle.is_cancel_requested:
        goal_handle.canceled()
        return Fibonacci.Result()
    goal_handle.succeed()
    return Fibonacci.Result(sequence=numbers)


rclpy.init()
node = Welder("welder", namespace="far")
server = ActionServer(
    node,
    Fibonacci,
    "weld",
    weld,
    goal_callback=lambda goal: GoalResponse.REJECT if goal.order == 0 else GoalResponse.ACCEPT,
    cancel_callback=lambda goal_handle: CancelResponse.ACCEPT,
)
spin(node)
