"""Managed nodes."""

from __future__ import annotations

import threading
import traceback
from typing import Any, NamedTuple

from lifecycle_msgs.msg import State, Transition, TransitionDescription, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup
from rclpy.lifecycle._state_machine import LifecycleStateMachine
from rclpy.lifecycle.managed_entity import ManagedEntity, TransitionCallbackReturn
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.node import Node
from rclpy.qos import qos_profile_default

#: The callbacks by the state in which they run.
_CALLBACKS = {
    State.TRANSITION_STATE_CONFIGURING: "on_configure",
    State.TRANSITION_STATE_CLEANINGUP: "on_cleanup",
    State.TRANSITION_STATE_SHUTTINGDOWN: "on_shutdown",
    State.TRANSITION_STATE_ACTIVATING: "on_activate",
    State.TRANSITION_STATE_DEACTIVATING: "on_deactivate",
    State.TRANSITION_STATE_ERRORPROCESSING: "on_error",
}


class LifecycleState(NamedTuple):
    """Label and identifier of a state."""

    label: str
    state_id: int


class LifecycleNodeMixin(ManagedEntity):
    """Makes a Node a managed one, together with which it is inherited.

    Each callback of a transition calls those of the managed entities, up to the first one that does not succeed; call
    it in an override. Without `enable_communication_interface` the node has no services for transitions;
    `callback_group` is the group of these.
    """

    get_logger: Any

    def __init__(
        self, *, enable_communication_interface: bool = True, callback_group: CallbackGroup | None = None
    ) -> None:
        if not isinstance(enable_communication_interface, bool):
            raise TypeError(
                f"enable_communication_interface must be a bool, got {type(enable_communication_interface).__name__}"
            )
        node: Any = self
        # In this order the callbacks of the entities are called.
        self._managed_entities: dict[ManagedEntity, None] = {}
        self._changing = threading.Lock()
        self._transition_event = Node.create_publisher(node, TransitionEvent, "~/transition_event", qos_profile_default)
        self._state_machine = LifecycleStateMachine(self.__notify)
        for name, (srv_type, callback) in {
            "change_state": (ChangeState, self.__on_change_state),
            "get_state": (GetState, self.__on_get_state),
            "get_available_states": (GetAvailableStates, self.__on_get_available_states),
            "get_available_transitions": (GetAvailableTransitions, self.__on_get_available_transitions),
            "get_transition_graph": (GetAvailableTransitions, self.__on_get_transition_graph),
        }.items():
            service = None
            if enable_communication_interface:
                service = Node.create_service(node, srv_type, f"~/{name}", callback, callback_group=callback_group)
                setattr(self, f"_service_{name}", service)
            setattr(self._state_machine, f"service_{name}", service)

    def __notify(self, described: TransitionDescription) -> None:
        event = TransitionEvent(start_state=described.start_state, goal_state=described.goal_state)
        self._transition_event.publish(event)

    # Transitions

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Configure; return what the callback returned, ERROR if it failed. RCLError if the state is a wrong one."""
        return self.__change_state(Transition.TRANSITION_CONFIGURE)

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Undo the configuration; as `trigger_configure`."""
        return self.__change_state(Transition.TRANSITION_CLEANUP)

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Activate; as `trigger_configure`."""
        return self.__change_state(Transition.TRANSITION_ACTIVATE)

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Deactivate; as `trigger_configure`."""
        return self.__change_state(Transition.TRANSITION_DEACTIVATE)

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Shut down; as `trigger_configure`."""
        return self.__change_state(self._state_machine.get_transition_by_label("shutdown"))

    def __change_state(self, transition_id: int) -> TransitionCallbackReturn:
        state_id, label = self._state_machine.current_state
        previous = LifecycleState(label, state_id)
        with self._changing:  # of two requests at a time one comes first, and the other is wrong then
            self._state_machine.trigger_transition(transition_id)
        returned = self.__finish(previous)
        if returned == TransitionCallbackReturn.ERROR:
            self.__finish(previous)  # error processing
        return returned

    def __finish(self, previous: LifecycleState) -> TransitionCallbackReturn:
        """Run the callback of the present state, and go on to the next one."""
        name = _CALLBACKS[self._state_machine.current_state[0]]
        outcome = TransitionCallbackReturn.ERROR
        try:
            returned = getattr(self, name)(previous)
            if isinstance(returned, TransitionCallbackReturn):
                outcome = returned
            else:
                self.get_logger().error(f"{name} returned {returned!r}, not a TransitionCallbackReturn: taken as ERROR")
        except Exception as error:
            self.get_logger().error(f"{name} failed: {type(error).__name__}: {error}\n{traceback.format_exc()}")
        self._state_machine.trigger_transition(self._state_machine.get_transition_by_label(outcome.to_label()))
        return outcome

    # Managed entities

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._managed_entities[entity] = None

    def _by_default(self, callback: str, state: LifecycleState) -> TransitionCallbackReturn:
        """Call the managed entities, up to the first one that does not succeed; return what the last one returned."""
        for entity in list(self._managed_entities):
            returned = getattr(entity, callback)(state)
            if not isinstance(returned, TransitionCallbackReturn):
                raise TypeError(f"{callback}() of {entity!r} returned {returned!r}, not a TransitionCallbackReturn")
            if returned != TransitionCallbackReturn.SUCCESS:
                return returned
        return TransitionCallbackReturn.SUCCESS

    def create_lifecycle_publisher(self, *args: Any, **kwargs: Any) -> LifecyclePublisher:
        """Create a publisher that sends only while the node is active; arguments as those of ``create_publisher``."""
        if "publisher_class" in kwargs:
            raise TypeError("create_publisher() got an unexpected keyword argument 'publisher_class'")
        node: Any = self
        publisher: Any = Node.create_publisher(node, *args, **kwargs, publisher_class=LifecyclePublisher)
        self._managed_entities[publisher] = None
        return publisher  # type: ignore[no-any-return]

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """Destroy a publisher of this node; return False if it is not one."""
        self._managed_entities.pop(publisher, None)
        node: Any = self
        return Node.destroy_publisher(node, publisher)

    # Services

    def __on_change_state(self, request: Any, response: Any) -> Any:
        # Unlike in genuine rclpy, a wrong request does not end the program.
        try:
            transition_id = request.transition.id
            if request.transition.label:
                transition_id = self._state_machine.get_transition_by_label(request.transition.label)
            response.success = self.__change_state(transition_id) == TransitionCallbackReturn.SUCCESS
        except RCLError as error:
            self.get_logger().warning(f"{error}")
        return response

    def __on_get_state(self, request: Any, response: Any) -> Any:
        response.current_state.id, response.current_state.label = self._state_machine.current_state
        return response

    def __on_get_available_states(self, request: Any, response: Any) -> Any:
        response.available_states = self._state_machine.available_states
        return response

    def __on_get_available_transitions(self, request: Any, response: Any) -> Any:
        response.available_transitions = self._state_machine.available_transitions
        return response

    def __on_get_transition_graph(self, request: Any, response: Any) -> Any:
        response.available_transitions = self._state_machine.transition_graph
        return response


class LifecycleNode(LifecycleNodeMixin, Node):
    """A managed node; the other arguments are those of `rclpy.node.Node`."""

    def __init__(self, node_name: str, *, enable_communication_interface: bool = True, **kwargs: Any) -> None:
        Node.__init__(self, node_name, **kwargs)
        LifecycleNodeMixin.__init__(self, enable_communication_interface=enable_communication_interface)
