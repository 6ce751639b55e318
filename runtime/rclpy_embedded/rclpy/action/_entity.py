"""What action servers and action clients share: three services and two topics under one name."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle, NameValidationException
from rclpy.impl.endpoint import Endpoint
from rclpy.impl.wait_set import WaitSet
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.type_support import check_for_type_support, check_is_valid_action_type
from rclpy.waitable import Waitable


def key_of(goal_id: Any) -> bytes:
    """Return the bytes of a UUID message."""
    return bytes(goal_id.uuid)


class ActionEntity(Waitable):
    """An action server or client of a node; ready when something has arrived at one of its endpoints."""

    def __init__(self, node: Any, action_type: Any, action_name: str, callback_group: CallbackGroup | None) -> None:
        check_for_type_support(action_type)
        check_is_valid_action_type(action_type)
        super().__init__(callback_group or node.default_callback_group)
        self._node = node
        self.action_type = action_type
        self._action_name = action_name
        self._endpoints: list[Endpoint] = []
        self._logger = node.get_logger().get_child(type(self).__name__.replace("Action", "action_").lower())

    def _open(self, kind: Any, interface: Any, part: str, qos_profile: QoSProfile, **options: Any) -> Any:
        """Make an endpoint for one part of the action; if that fails, close those that were made before."""
        node, is_topic = self._node, part in ("feedback", "status")
        try:
            # The action is remapped as a whole, as since rcl_action 9.2.8, and each part of it, as before.
            name = f"{node.resolve_topic_name(self._action_name)}/_action/{part}"
            full_name = node.resolve_topic_name(name) if is_topic else node.resolve_service_name(name)
            arguments = [node.handle, interface, name, full_name, qos_profile]
            if is_topic:
                callbacks = PublisherEventCallbacks if kind is Publisher else SubscriptionEventCallbacks
                arguments.append(callbacks(use_default_callbacks=False))
            with node.handle.session.using(f"failed to create {part} of the action '{self._action_name}'"):
                endpoint = kind(*arguments, self.callback_group, **options)
        except NameValidationException as error:
            self.destroy()
            text = f"'{self._action_name}' is not the name of an action: {error}"
            raise ValueError(text) from None
        except Exception:
            self.destroy()
            raise
        self._endpoints.append(endpoint)
        return endpoint

    def _open_services(
        self, kind: Any, goal: QoSProfile, cancel: QoSProfile, result: QoSProfile, **options: Any
    ) -> dict[str, Any]:
        """Make the services, or the clients of these, with a profile for each."""
        impl = self.action_type.Impl
        return {
            "goal": self._open(kind, impl.SendGoalService, "send_goal", goal, **options),
            "cancel": self._open(kind, impl.CancelGoalService, "cancel_goal", cancel, **options),
            "result": self._open(kind, impl.GetResultService, "get_result", result, **options),
        }

    def _open_topics(self, kind: Any, feedback: QoSProfile, status: QoSProfile, **options: Any) -> tuple[Any, Any]:
        """Make the publishers, or the subscriptions, with a profile for each: feedback and status."""
        impl = self.action_type.Impl
        return (
            self._open(kind, impl.FeedbackMessage, "feedback", feedback, **options),
            self._open(kind, impl.GoalStatusMessage, "status", status, **options),
        )

    def _attach(self) -> None:
        """Let the executor wait for this entity; InvalidHandle if another thread has destroyed the node meanwhile."""
        self._node.add_waitable(self)
        try:
            _ = self._node.handle
        except InvalidHandle:  # perhaps before it could see this entity
            self.destroy()
            raise

    def add_to_wait_set(self, wait_set: WaitSet) -> None:
        """Let all readers wake the executor."""
        readers = [endpoint.condition for endpoint in self._endpoints if endpoint.condition is not None]
        self._numbers = [wait_set.add_subscription(reader) for reader in readers]

    def is_ready(self, wait_set: WaitSet) -> bool:
        return any(wait_set.is_ready("subscription", number) for number in self._numbers)

    def destroy(self) -> None:
        with suppress(ValueError):  # not there yet, or not any more
            self._node.remove_waitable(self)
        for endpoint in self._endpoints:
            endpoint.destroy()

    def _end(self) -> None:
        self.destroy()
