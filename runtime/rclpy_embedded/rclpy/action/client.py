"""Action clients."""

from __future__ import annotations

import uuid
import weakref
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action._entity import ActionEntity, key_of
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.executors import await_or_execute
from rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.utilities import wait_until
from rclpy.waitable import NumberOfEntities
from unique_identifier_msgs.msg import UUID

_TERMINAL = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)


class ClientGoalHandle:
    """A goal that was sent."""

    def __init__(self, action_client: ActionClient, goal_id: Any, goal_response: Any) -> None:
        self._action_client = action_client
        #: UUID message of the goal.
        self.goal_id = goal_id
        #: When the server accepted the goal.
        self.stamp = goal_response.stamp
        #: Whether the server accepted the goal.
        self.accepted: bool = goal_response.accepted
        #: A constant of ``action_msgs/msg/GoalStatus``, as the server has published it last.
        self.status: int = GoalStatus.STATUS_UNKNOWN

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ClientGoalHandle) and bool(self.goal_id == other.goal_id)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"ClientGoalHandle <id={self.goal_id.uuid}, accepted={self.accepted}, status={self.status}>"

    def cancel_goal(self) -> Any:
        """Ask for cancellation and wait for the response. Not for use in callbacks: it would block the executor."""
        return self.cancel_goal_async()._wait()

    def cancel_goal_async(self) -> Future:
        """Ask for cancellation; the future completes with the response."""
        return self._action_client._cancel_goal_async(self)

    def get_result(self) -> Any:
        """Ask for the result and wait for it. Not for use in callbacks: it would block the executor."""
        return self.get_result_async()._wait()

    def get_result_async(self) -> Future:
        """Ask for the result; the future completes with status and result once the goal has ended."""
        return self._action_client._get_result_async(self)


class _GoalFuture(Future):
    """Of a response about a goal."""

    def __init__(self, goal_id: Any) -> None:
        super().__init__()
        self.goal_id = goal_id


class ActionClient(ActionEntity):
    """Sends goals to an action server, cancels them and receives feedback, status and results."""

    def __init__(
        self,
        node: Any,
        action_type: Any,
        action_name: str,
        *,
        callback_group: CallbackGroup | None = None,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_sub_qos_profile: QoSProfile = QoSProfile(depth=10),  # noqa: B008
        status_sub_qos_profile: QoSProfile = qos_profile_action_status_default,
    ) -> None:
        super().__init__(node, action_type, action_name, callback_group)
        # By the bytes of the goal's UUID.
        self._goal_handles: dict[bytes, weakref.ref[ClientGoalHandle]] = {}
        self._feedback_callbacks: dict[bytes, Callable[[Any], Any]] = {}
        services = goal_service_qos_profile, cancel_service_qos_profile, result_service_qos_profile
        self._clients: dict[str, Client] = self._open_services(Client, *services, context=node.context)
        topics = feedback_sub_qos_profile, status_sub_qos_profile
        self._feedback, self._status = self._open_topics(Subscription, *topics, callback=lambda _: None, raw=False)
        self._attach()

    def get_num_entities(self) -> NumberOfEntities:
        return NumberOfEntities(num_subscriptions=2, num_clients=3)

    def take_data(self) -> dict[str, Any]:
        """Take one response of each kind, the last status, and all feedback: what follows it may be the result."""
        taken: dict[str, Any] = {key: client.take_response() for key, client in self._clients.items()}
        taken["feedback"] = []
        while (feedback := self._feedback.take()) is not None:
            taken["feedback"].append(feedback[0])
        status = self._status.take()
        taken["status"] = None if status is None else status[0]
        return taken

    async def execute(self, taken_data: dict[str, Any]) -> None:
        """Complete futures, call feedback callbacks and update the status of goals."""
        finished = []
        for key, client in self._clients.items():
            if taken_data[key] is None:
                continue
            number, response = taken_data[key]
            future = client._pending_requests.get(number)
            if not isinstance(future, _GoalFuture):
                self._logger.warning(
                    f"Ignoring unexpected {key} response. There may be more than one action server for the action "
                    f"'{self._action_name}'"
                )
                continue
            if key == "goal":
                response = self._goal_handle(future.goal_id, response)
            elif key == "result":
                finished.append(key_of(future.goal_id))
            future.set_result(response)
        for feedback in taken_data["feedback"]:
            callback = self._feedback_callbacks.get(key_of(feedback.goal_id))
            if callback is not None:
                await await_or_execute(callback, feedback)
        for goal in finished:
            self._feedback_callbacks.pop(goal, None)
        if taken_data["status"] is not None:
            self._update_status(taken_data["status"])

    def _goal_handle(self, goal_id: Any, response: Any) -> ClientGoalHandle:
        goal_handle, key = ClientGoalHandle(self, goal_id, response), key_of(goal_id)
        if not goal_handle.accepted:
            self._feedback_callbacks.pop(key, None)
        elif key in self._goal_handles:
            raise RuntimeError(f"Two goals were accepted with the same ID ({goal_handle})")
        else:
            self._goal_handles[key] = weakref.ref(goal_handle)
        return goal_handle

    def _update_status(self, message: Any) -> None:
        for status in message.status_list:
            key = key_of(status.goal_info.goal_id)
            reference = self._goal_handles.get(key)
            if reference is None:
                continue
            goal_handle = reference()
            if goal_handle is not None:
                goal_handle.status = status.status
            if goal_handle is None or status.status in _TERMINAL:
                del self._goal_handles[key]

    def _call(self, part: str, request: Any, goal_id: Any) -> Future:
        future = _GoalFuture(goal_id)
        self.add_future(future)
        future.add_done_callback(self.remove_future)
        return self._clients[part]._complete(future, request)

    def send_goal(self, goal: Any, **kwargs: Any) -> Any:
        """Send a goal and wait for its result. Not for use in callbacks: it would block the executor.

        The arguments are those of `send_goal_async`.
        """
        return self.send_goal_async(goal, **kwargs)._wait().get_result()

    def send_goal_async(
        self, goal: Any, feedback_callback: Callable[[Any], Any] | None = None, goal_uuid: Any = None
    ) -> Future:
        """Send a goal; the future completes with a ClientGoalHandle once the server has accepted or rejected it.

        `feedback_callback` takes the feedback messages of this goal. TypeError if `goal` is not one of this action.
        """
        if not isinstance(goal, self.action_type.Goal):
            raise TypeError(f"Expected {self.action_type.Goal}, got {type(goal)}")
        goal_id = UUID(uuid=list(uuid.uuid4().bytes)) if goal_uuid is None else goal_uuid
        request = self.action_type.Impl.SendGoalService.Request(goal_id=goal_id, goal=goal)
        if feedback_callback is not None:
            self._feedback_callbacks[key_of(goal_id)] = feedback_callback
        return self._call("goal", request, goal_id)

    def _cancel_goal_async(self, goal_handle: ClientGoalHandle) -> Future:
        request = self.action_type.Impl.CancelGoalService.Request()
        request.goal_info.goal_id = goal_handle.goal_id
        return self._call("cancel", request, goal_handle.goal_id)

    def _get_result_async(self, goal_handle: ClientGoalHandle) -> Future:
        request = self.action_type.Impl.GetResultService.Request(goal_id=goal_handle.goal_id)
        return self._call("result", request, goal_handle.goal_id)

    def server_is_ready(self) -> bool:
        """Return whether a server is there, with all its services and topics."""
        return all(client.service_is_ready() for client in self._clients.values()) and all(
            subscription.get_publisher_count() for subscription in (self._feedback, self._status)
        )

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Wait for a server; return whether there is one. Without a timeout, wait without a limit."""
        return wait_until(self.server_is_ready, timeout_sec, self._node.context)
