"""Drives the managed node ``/far/welder`` and its action ``/far/weld``, and prints what comes back."""

import rclpy
from action_msgs.msg import GoalStatusArray
from example_interfaces.action import Fibonacci
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.action import ActionClient
from rclpy.qos import qos_profile_action_status_default


def wait(future):
    rclpy.spin_until_future_complete(node, future, timeout_sec=120)
    return future.result()


def ask(kind, name, request=None):
    client = node.create_client(kind, f"/far/welder/{name}")
    assert client.wait_for_service(120)
    return wait(client.call_async(kind.Request() if request is None else request))


def spin_until(condition):
    while not condition():
        rclpy.spin_once(node, timeout_sec=0.1)


rclpy.init()
node = rclpy.create_node("weld_caller")
print("ready", flush=True)
feedback, events, statuses = [], [], set()


def note(message):
    for status in message.status_list:
        statuses.add((bytes(status.goal_info.goal_id.uuid), status.status))


node.create_subscription(GoalStatusArray, "/far/weld/_action/status", note, qos_profile_action_status_default)
node.create_subscription(TransitionEvent, "/far/welder/transition_event", events.append, 10)
client = ActionClient(node, Fibonacci, "/far/weld")
assert client.wait_for_server(120)

for order in (0, 5, -1):
    feedback.clear()
    goal_handle = wait(client.send_goal_async(Fibonacci.Goal(order=order), feedback_callback=feedback.append))
    print(order, goal_handle.accepted, flush=True)
    if order:
        result = goal_handle.get_result_async()
        spin_until(lambda: len(feedback) > 2)
        print([list(message.feedback.sequence) for message in feedback[:2]], flush=True)
        if order < 0:
            response = wait(goal_handle.cancel_goal_async())
            print(response.return_code, [info.goal_id == goal_handle.goal_id for info in response.goals_canceling])
        response = wait(result)
        print(response.status, list(response.result.sequence), flush=True)
        known = bytes(goal_handle.goal_id.uuid), response.status
        spin_until(lambda known=known: known in statuses)
    print(wait(goal_handle.cancel_goal_async()).return_code, flush=True)

for transition in (
    Transition(label="activate"),
    Transition(id=Transition.TRANSITION_CONFIGURE),
    Transition(id=Transition.TRANSITION_ACTIVATE),
    Transition(label="deactivate"),
    Transition(id=Transition.TRANSITION_ACTIVE_SHUTDOWN),
):
    print(ask(ChangeState, "change_state", ChangeState.Request(transition=transition)).success, flush=True)
    print(ask(GetState, "get_state"), flush=True)
    print(ask(GetAvailableTransitions, "get_available_transitions"), flush=True)
print(ask(GetAvailableStates, "get_available_states"), ask(GetAvailableTransitions, "get_transition_graph"), flush=True)
spin_until(lambda: events and events[-1].goal_state.label == "unconfigured")
print(events, flush=True)
node.destroy_node()
rclpy.shutdown()
