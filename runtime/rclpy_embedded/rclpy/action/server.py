"""Action servers."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import Any

from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from rclpy._rclpy_pybind11 import InvalidHandle, RCLError
from rclpy.action._entity import ActionEntity, key_of
from rclpy.callback_groups import CallbackGroup
from rclpy.constants import S_TO_NS
from rclpy.executors import await_or_execute
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from rclpy.service import Service, ServiceInfo
from rclpy.task import Future
from rclpy.time import Time
from rclpy.waitable import NumberOfEntities


class GoalResponse(Enum):
    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    REJECT = 1
    ACCEPT = 2


class GoalEvent(Enum):
    """What changes the status of a goal."""

    EXECUTE = 0
    CANCEL_GOAL = 1
    SUCCEED = 2
    ABORT = 3
    CANCELED = 4


_ACCEPTED, _EXECUTING = GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING
_CANCELING = GoalStatus.STATUS_CANCELING
_ACTIVE = (_ACCEPTED, _EXECUTING, _CANCELING)
_CANCELABLE = (_ACCEPTED, _EXECUTING)
#: From which states an event leads to which one.
_TRANSITIONS: dict[GoalEvent, tuple[tuple[int, ...], int]] = {
    GoalEvent.EXECUTE: ((_ACCEPTED,), _EXECUTING),
    GoalEvent.CANCEL_GOAL: (_CANCELABLE, _CANCELING),
    GoalEvent.SUCCEED: ((_EXECUTING, _CANCELING), GoalStatus.STATUS_SUCCEEDED),
    GoalEvent.ABORT: ((_EXECUTING, _CANCELING), GoalStatus.STATUS_ABORTED),
    GoalEvent.CANCELED: ((_CANCELING,), GoalStatus.STATUS_CANCELED),
}


class ServerGoalHandle:
    """A goal that the server has accepted; made by ActionServer."""

    def __init__(self, action_server: ActionServer, goal_info: Any, goal_request: Any) -> None:
        self._action_server = action_server
        self._goal_info = goal_info
        #: UUID message of the goal.
        self.goal_id = goal_info.goal_id
        #: The goal message.
        self.request = goal_request
        self._state = _ACCEPTED
        self._destroyed = False
        self._ended_ns: int | None = None
        #: Of the response that tells the result.
        self._ended = Future()
        action_server.add_future(self._ended)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ServerGoalHandle) and bool(self.goal_id == other.goal_id)

    __hash__ = None  # type: ignore[assignment]

    @property
    def is_active(self) -> bool:
        return not self._destroyed and self._state in _ACTIVE

    @property
    def is_cancel_requested(self) -> bool:
        """Whether a request to cancel the goal was accepted."""
        return self.status == _CANCELING

    @property
    def status(self) -> int:
        """A constant of ``action_msgs/msg/GoalStatus``."""
        return GoalStatus.STATUS_UNKNOWN if self._destroyed else self._state

    def _update_state(self, event: GoalEvent) -> None:
        server = self._action_server
        with server._lock:
            if self._destroyed:
                return
            allowed, state = _TRANSITIONS[event]
            if self._state not in allowed:
                raise RCLError(f"Failed to update goal state: no {event.name} in state {self._state}")
            self._state = state
            if not self.is_active:
                self._ended_ns = server._node.get_clock().now().nanoseconds
                server._plan_expiry()
            server._publish_status()

    def execute(self, execute_callback: Callable[[ServerGoalHandle], Any] | None = None) -> None:
        # A goal that was canceled before goes to the callback, too, which ends it.
        if not self.is_cancel_requested:
            self._update_state(GoalEvent.EXECUTE)
        self._action_server.notify_execute(self, execute_callback)

    def publish_feedback(self, feedback: Any) -> None:
        """Publish feedback of this goal; TypeError if it is not the feedback message of the action."""
        action_type: Any = self._action_server.action_type
        if not isinstance(feedback, action_type.Feedback):
            raise TypeError(f"Expected {action_type.Feedback}, got {type(feedback)}")
        if not self._destroyed:
            message = action_type.Impl.FeedbackMessage(goal_id=self.goal_id, feedback=feedback)
            self._action_server._feedback_publisher.publish(message)

    def succeed(self) -> None:
        self._update_state(GoalEvent.SUCCEED)

    def abort(self) -> None:
        self._update_state(GoalEvent.ABORT)

    def canceled(self) -> None:
        self._update_state(GoalEvent.CANCELED)

    def destroy(self) -> None:
        """Forget the goal; what is done with the handle later has no effect."""
        self._destroyed = True


def default_handle_accepted_callback(goal_handle: ServerGoalHandle) -> None:
    goal_handle.execute()


def default_goal_callback(goal_request: Any) -> GoalResponse:
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: Any) -> CancelResponse:
    return CancelResponse.REJECT


class ActionServer(ActionEntity):
    """Accepts goals, executes them and sends feedback, status and results.

    `result_timeout` is how many seconds a result is kept after its goal has ended.
    """

    def __init__(
        self,
        node: Any,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[[ServerGoalHandle], Any],
        *,
        callback_group: CallbackGroup | None = None,
        goal_callback: Callable[[Any], Any] | None = default_goal_callback,
        handle_accepted_callback: Callable[[ServerGoalHandle], Any] | None = default_handle_accepted_callback,
        cancel_callback: Callable[[ServerGoalHandle], Any] | None = default_cancel_callback,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_pub_qos_profile: QoSProfile = QoSProfile(depth=10),  # noqa: B008
        status_pub_qos_profile: QoSProfile = qos_profile_action_status_default,
        result_timeout: float = 900,
    ) -> None:
        super().__init__(node, action_type, action_name, callback_group)
        # Guards the states of all goals, so that statuses are published in the order in which they change.
        self._lock = threading.RLock()
        self._result_timeout_ns = int(result_timeout * S_TO_NS)
        # By the bytes of the goal's UUID.
        self._goal_handles: dict[bytes, ServerGoalHandle] = {}
        self.register_handle_accepted_callback(handle_accepted_callback)
        self.register_goal_callback(goal_callback)
        self.register_cancel_callback(cancel_callback)
        self.register_execute_callback(execute_callback)
        if self._result_timeout_ns < 0:
            raise ValueError(f"result_timeout must not be negative, got {result_timeout}")
        # Requests are taken by this class: most responses follow later than a service's callback returns.
        services = goal_service_qos_profile, cancel_service_qos_profile, result_service_qos_profile
        self._services: dict[str, Service] = self._open_services(Service, *services, callback=lambda *_: None)
        topics = feedback_pub_qos_profile, status_pub_qos_profile
        self._feedback_publisher, self._status_publisher = self._open_topics(Publisher, *topics)
        timeout_sec = self._result_timeout_ns / S_TO_NS
        self._expire_timer = node.create_timer(timeout_sec, self._expire_goals, self.callback_group, autostart=False)
        self._attach()

    def get_num_entities(self) -> NumberOfEntities:
        return NumberOfEntities(num_timers=1, num_services=3)

    def take_data(self) -> dict[str, Any]:
        """Take one request of each kind."""
        taken = {key: service.take_request() for key, service in self._services.items()}
        return {key: request for key, request in taken.items() if request is not None}

    async def execute(self, taken_data: dict[str, Any]) -> None:
        if "goal" in taken_data:
            await self._execute_goal_request(*taken_data["goal"])
        if "cancel" in taken_data:
            await self._execute_cancel_request(*taken_data["cancel"])
        if "result" in taken_data:
            self._execute_get_result_request(*taken_data["result"])

    def _respond(self, kind: str, response: Any, header: ServiceInfo) -> bool:
        try:
            self._services[kind].send_response(response, header)
        except (InvalidHandle, RCLError):
            self._logger.warning(f"Failed to send {kind} response (the client may have gone away)")
            return False
        return True

    async def _execute_goal_request(self, request: Any, header: ServiceInfo) -> None:
        key = key_of(request.goal_id)
        goal_handle = None
        if key not in self._goal_handles:
            answer = await await_or_execute(self._goal_callback, request.goal)
            if not isinstance(answer, GoalResponse):
                self._logger.warning("Goal request callback did not return a GoalResponse type. Rejecting goal.")
            elif answer is GoalResponse.ACCEPT:
                goal_handle = self._accept(key, request)
        response = self.action_type.Impl.SendGoalService.Response(accepted=goal_handle is not None)
        if goal_handle is not None:
            response.stamp = goal_handle._goal_info.stamp
        if self._respond("goal", response, header) and goal_handle is not None:
            await await_or_execute(self._handle_accepted_callback, goal_handle)

    def _accept(self, key: bytes, request: Any) -> ServerGoalHandle | None:
        with self._lock:
            if key in self._goal_handles:  # accepted while the callback was busy with this one
                self._logger.error(f"Failed to accept new goal with ID {request.goal_id.uuid}: it exists already")
                return None
            goal_info = GoalInfo(goal_id=request.goal_id, stamp=self._node.get_clock().now().to_msg())
            goal_handle = self._goal_handles[key] = ServerGoalHandle(self, goal_info, request.goal)
            return goal_handle

    async def _execute_goal(self, execute_callback: Callable[..., Any], goal_handle: ServerGoalHandle) -> None:
        try:
            result = await await_or_execute(execute_callback, goal_handle)
        except Exception as error:
            # The client still gets a response.
            result = self.action_type.Result()
            self._logger.error(f"Error raised in execute callback: {error}")
            traceback.print_exc()
        if goal_handle.is_active:
            self._logger.warning(f"Goal state not set, assuming aborted. Goal ID: {goal_handle.goal_id.uuid}")
            goal_handle.abort()
        if not goal_handle._destroyed:  # nor expired
            response = self.action_type.Impl.GetResultService.Response(status=goal_handle.status)
            response.result = result
            goal_handle._ended.set_result(response)

    async def _execute_cancel_request(self, request: Any, header: ServiceInfo) -> None:
        response = self.action_type.Impl.CancelGoalService.Response()
        with self._lock:
            response.return_code, candidates = self._to_cancel(request.goal_info)
        for goal_handle in candidates:
            answer = await await_or_execute(self._cancel_callback, goal_handle)
            if answer is CancelResponse.ACCEPT:
                try:
                    goal_handle._update_state(GoalEvent.CANCEL_GOAL)
                    response.goals_canceling.append(goal_handle._goal_info)
                except RCLError as error:  # it has ended in the meantime
                    self._logger.debug(f"Failed to cancel goal in cancel callback: {error}")
        self._respond("cancel", response, header)

    def _to_cancel(self, goal_info: Any) -> tuple[int, list[ServerGoalHandle]]:
        """Return code and goals that a request is about: one goal, all up to a time (and that one), or all."""
        none, key = CancelGoal.Response.ERROR_NONE, key_of(goal_info.goal_id)
        until_ns = Time.from_msg(goal_info.stamp).nanoseconds
        if any(key) and not until_ns:
            if key not in self._goal_handles:
                return CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID, []
            if self._goal_handles[key].status not in _CANCELABLE:
                return CancelGoal.Response.ERROR_GOAL_TERMINATED, []
            return none, [self._goal_handles[key]]
        return none, [
            goal_handle
            for other, goal_handle in self._goal_handles.items()
            if goal_handle.status in _CANCELABLE
            and (not until_ns or other == key or Time.from_msg(goal_handle._goal_info.stamp).nanoseconds <= until_ns)
        ]

    def _execute_get_result_request(self, request: Any, header: ServiceInfo) -> None:
        goal_handle = self._goal_handles.get(key_of(request.goal_id))
        if goal_handle is None:
            unknown = self.action_type.Impl.GetResultService.Response(status=GoalStatus.STATUS_UNKNOWN)
            self._respond("result", unknown, header)
        else:
            goal_handle._ended.add_done_callback(partial(self._send_result_response, header))

    def _send_result_response(self, header: ServiceInfo, future: Future) -> None:
        self._respond("result", future.result(), header)

    def _publish_status(self) -> None:
        self._status_publisher.publish(
            GoalStatusArray(
                status_list=[
                    GoalStatus(goal_info=goal_handle._goal_info, status=goal_handle._state)
                    for goal_handle in self._goal_handles.values()
                ]
            )
        )

    def _plan_expiry(self) -> None:
        """Set the timer to when the next goal expires."""
        ended = [handle._ended_ns for handle in self._goal_handles.values() if handle._ended_ns is not None]
        self._expire_timer.cancel()
        if ended:
            left = min(ended) + self._result_timeout_ns - self._node.get_clock().now().nanoseconds
            self._expire_timer.timer_period_ns = max(0, left)
            self._expire_timer.reset()

    def _expire_goals(self) -> None:
        with self._lock:
            limit = self._node.get_clock().now().nanoseconds - self._result_timeout_ns
            for key, goal_handle in list(self._goal_handles.items()):
                if goal_handle._ended_ns is not None and goal_handle._ended_ns <= limit:
                    goal_handle.destroy()
                    del self._goal_handles[key]
                    self.remove_future(goal_handle._ended)
            self._plan_expiry()

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[[ServerGoalHandle], Any] | None
    ) -> None:
        """Have the executor run a goal's callback, by default the one of the server."""
        self._node.executor.create_task(self._execute_goal, execute_callback or self._execute_callback, goal_handle)

    def register_handle_accepted_callback(self, handle_accepted_callback: Callable[..., Any] | None) -> None:
        """Set what gets the handle of an accepted goal, by default to execute it."""
        self._handle_accepted_callback = handle_accepted_callback or default_handle_accepted_callback

    def register_goal_callback(self, goal_callback: Callable[[Any], Any] | None) -> None:
        """Set what decides by a GoalResponse whether a goal is accepted; all are by default."""
        self._goal_callback = goal_callback or default_goal_callback

    def register_cancel_callback(self, cancel_callback: Callable[..., Any] | None) -> None:
        """Set what decides by a CancelResponse whether a goal is canceled; none is by default."""
        self._cancel_callback = cancel_callback or default_cancel_callback

    def register_execute_callback(self, execute_callback: Callable[[ServerGoalHandle], Any]) -> None:
        """Set what executes goals: it takes a ServerGoalHandle and returns the result message."""
        if not callable(execute_callback):
            raise TypeError("Failed to register goal execution callback: not callable")
        self._execute_callback = execute_callback

    def destroy(self) -> None:
        """Destroy the services and topics of the action, and the goals."""
        for goal_handle in list(self._goal_handles.values()):
            goal_handle.destroy()
        self._futures.clear()
        if hasattr(self, "_expire_timer"):
            self._node.destroy_timer(self._expire_timer)
        super().destroy()
