"""Requests of a scenario for another controller, by the supervisor's service."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node
from rclpy.task import Future

from fsw_control import messages_ros as convert
from fsw_control.topics_ros import LATEST
from fsw_msgs.msg import SupervisorState
from fsw_msgs.srv import SwitchController
from fsw_scenario.timeline import SWITCH_TIMEOUT_S

#: time limit for the supervisor to receive a request, on a busy machine or while it is dead [s]
#: (chosen)
_DELIVERY_S = 2.0


class Switching:
    """Sends requests for a controller, and knows whether the supervisor has received the last one.

    The service answers when the new controller is applied, ticks later. In lockstep the plant must
    not take its next step before the request has arrived, or the tick of the swap would depend on
    the machine's load. Receipt shows in the supervisor's state, as the target, or in a refusal;
    ``on_received`` is called then.
    """

    def __init__(self, node: Node, on_received: Callable[[], object]) -> None:
        self._node, self._on_received = node, on_received
        self._client = node.create_client(SwitchController, "fsw/switch_controller")
        self._states = node.create_subscription(
            SupervisorState, "fsw/supervisor/state", self._on_state, LATEST
        )
        self._target = ""  # by the supervisor's last state
        self._requested = ""  # not received yet
        self._asked_s = 0.0
        self._answer: Future | None = None

    @property
    def pending(self) -> bool:
        """Whether the supervisor has yet to receive a request; false after a time-out."""
        return bool(self._requested) and time.monotonic() - self._asked_s < _DELIVERY_S

    def ask(self, controller: str) -> None:
        """Request a controller; an earlier request is superseded."""
        self._forget()
        self._requested, self._asked_s = controller, time.monotonic()
        self.look()

    def look(self) -> None:
        """Send the request as soon as a supervisor is there; call it often."""
        if self._requested and self._answer is None and self._client.service_is_ready():
            request = convert.switch_request(self._requested, SWITCH_TIMEOUT_S)
            self._answer = self._client.call_async(request)
            self._answer.add_done_callback(self._on_answer)
            self._look_at_target()
        elif self._requested and not self.pending:
            self._node.get_logger().error(
                f"no supervisor has received the request for {self._requested}: it is dropped"
            )
            self._received()

    def _on_state(self, message: SupervisorState) -> None:
        self._target = message.target_controller
        self._look_at_target()

    def _look_at_target(self) -> None:
        if self._answer is not None and self._target == self._requested:
            self._received()

    def _on_answer(self, answer: Future) -> None:
        if answer is self._answer:
            self._received()

    def _received(self) -> None:
        if self._requested:
            self._forget()
            self._on_received()

    def _forget(self) -> None:
        """Expect nothing of the last request any more."""
        if self._answer is not None:
            self._client.remove_pending_request(self._answer)
        self._requested, self._answer = "", None

    def destroy(self) -> None:
        """Leave the graph; an answer that is on its way has no effect."""
        self._forget()
        self._node.destroy_client(self._client)
        self._node.destroy_subscription(self._states)
