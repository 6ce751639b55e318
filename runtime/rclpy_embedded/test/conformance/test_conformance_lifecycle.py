"""Managed nodes: transitions and their callbacks, services, events, managed entities."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partialmethod
from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy import lifecycle
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.lifecycle import (
    LifecycleNode,
    LifecycleNodeMixin,
    LifecycleState,
    ManagedEntity,
    SimpleManagedEntity,
    TransitionCallbackReturn,
)
from rclpy.node import Node
from std_msgs.msg import String

PATIENCE_S = 240.0
SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)
UNCONFIGURED = LifecycleState(label="unconfigured", state_id=State.PRIMARY_STATE_UNCONFIGURED)
INACTIVE = LifecycleState(label="inactive", state_id=State.PRIMARY_STATE_INACTIVE)
#: How a node gets into the state from which a transition starts.
BEFORE = {
    "configure": [],
    "cleanup": ["configure"],
    "activate": ["configure"],
    "deactivate": ["configure", "activate"],
    "shutdown": ["configure"],
}
#: Where success and failure lead to.
AFTER = {
    "configure": ("inactive", "unconfigured"),
    "cleanup": ("unconfigured", "inactive"),
    "activate": ("active", "inactive"),
    "deactivate": ("inactive", "active"),
    "shutdown": ("finalized", "finalized"),
}


class Recording(LifecycleNode):
    """Notes its callbacks and does in them what `plan` says: return a value or raise an exception."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.calls: list[tuple[str, Any]] = []
        self.plan: dict[str, Any] = {}
        super().__init__(*args, **kwargs)

    def _act(self, name: str, state: Any) -> Any:
        self.calls.append((name, state))
        planned = self.plan.get(name, SUCCESS)
        if isinstance(planned, Exception):
            raise planned
        return planned

    on_configure = partialmethod(_act, "configure")
    on_cleanup = partialmethod(_act, "cleanup")
    on_activate = partialmethod(_act, "activate")
    on_deactivate = partialmethod(_act, "deactivate")
    on_shutdown = partialmethod(_act, "shutdown")
    on_error = partialmethod(_act, "error")

    def trigger(self, *names: str) -> Any:
        """Trigger transitions; return what the last one did."""
        return [getattr(self, f"trigger_{name}")() for name in names][-1]

    @property
    def label(self) -> str:
        """Label of the state."""
        return str(self._state_machine.current_state[1])


@pytest.fixture
def managed(context: Any) -> Iterator[Recording]:
    """A managed node named managed."""
    node = Recording("managed", context=context)
    yield node
    node.destroy_node()


@pytest.fixture
def ask(node: Any, spinner: Any, managed: Recording) -> Callable[..., Any]:
    """Call one of the managed node's services from another node."""
    spinner.executor.add_node(managed)

    def call(kind: Any, name: str, request: Any = None) -> Any:
        client = node.create_client(kind, f"/managed/{name}")
        assert client.wait_for_service(PATIENCE_S)
        future = client.call_async(kind.Request() if request is None else request)
        assert spinner.until(future.done)
        return future.result()

    return call


def change(ask: Callable[..., Any], transition_id: int = 0, label: str = "") -> bool:
    """Ask for a transition; return whether it succeeded."""
    request = ChangeState.Request(transition=Transition(id=transition_id, label=label))
    return bool(ask(ChangeState, "change_state", request).success)


def test_a_whole_life(node: Any, spinner: Any, managed: Recording) -> None:
    events: list[tuple[str, str]] = []
    node.create_subscription(
        TransitionEvent,
        "/managed/transition_event",
        lambda event: events.append((event.start_state.label, event.goal_state.label)),
        10,
    )
    assert managed.label == "unconfigured"
    assert managed.trigger("configure", "activate", "deactivate", "cleanup", "shutdown") == SUCCESS
    assert [name for name, _ in managed.calls] == ["configure", "activate", "deactivate", "cleanup", "shutdown"]
    assert [state.label for _, state in managed.calls] == [
        "unconfigured",
        "inactive",
        "active",
        "inactive",
        "unconfigured",
    ]
    assert managed.calls[0][1] == UNCONFIGURED
    assert managed.calls[1][1] == INACTIVE
    assert spinner.until(lambda: len(events) == 10)
    assert events[:4] == [
        ("unconfigured", "configuring"),
        ("configuring", "inactive"),
        ("inactive", "activating"),
        ("activating", "active"),
    ]
    assert events[-2:] == [("unconfigured", "shuttingdown"), ("shuttingdown", "finalized")]


@pytest.mark.parametrize("name", AFTER)
def test_where_a_callback_leads_to(managed: Recording, name: str) -> None:
    success, failure = AFTER[name]
    managed.trigger("configure", "cleanup", *BEFORE[name])
    managed.plan[name] = FAILURE
    assert managed.trigger(name) == FAILURE
    assert managed.label == failure
    if name != "shutdown":
        managed.plan[name] = SUCCESS
        assert managed.trigger(name) == SUCCESS
        assert managed.label == success
    assert "error" not in [call for call, _ in managed.calls]


@pytest.mark.parametrize("outcome", [ERROR, RuntimeError("no thermocouple")])
@pytest.mark.parametrize("name", AFTER)
def test_an_error_is_processed(managed: Recording, name: str, outcome: Any) -> None:
    managed.trigger("configure", "cleanup", *BEFORE[name])
    before = managed._state_machine.current_state
    managed.plan[name] = outcome
    assert managed.trigger(name) == ERROR
    assert managed.calls[-1] == ("error", LifecycleState(label=before[1], state_id=before[0]))
    assert managed.label == "unconfigured"
    managed.plan.clear()
    assert managed.trigger("configure") == SUCCESS  # as good as new


@pytest.mark.parametrize("outcome", [FAILURE, ERROR, RuntimeError("worse")])
def test_an_error_that_cannot_be_processed_is_the_end(managed: Recording, outcome: Any) -> None:
    managed.plan = {"configure": RuntimeError("no thermocouple"), "error": outcome}
    assert managed.trigger("configure") == ERROR
    assert managed.label == "finalized"
    for name in AFTER:
        with pytest.raises(RCLError):
            managed.trigger(name)


@pytest.mark.parametrize("returned", [None, True, "success"])
def test_a_callback_that_returns_something_else_failed(managed: Recording, genuine: bool, returned: Any) -> None:
    if genuine:
        pytest.skip("an AttributeError leaves the node in the state configuring")
    managed.plan["configure"] = returned
    assert managed.trigger("configure") == ERROR
    assert managed.label == "unconfigured"


def test_wrong_transitions(managed: Recording) -> None:
    for names, wrong in (
        (["configure"], ["configure", "deactivate"]),
        (["activate"], ["configure", "activate", "cleanup"]),
        (["shutdown"], list(AFTER)),
    ):
        managed.trigger(*names)
        label, calls = managed.label, len(managed.calls)
        for name in wrong:
            with pytest.raises(RCLError):
                managed.trigger(name)
        assert (managed.label, len(managed.calls)) == (label, calls)


def test_services(ask: Callable[..., Any], managed: Recording) -> None:
    assert ask(GetState, "get_state").current_state == State(id=1, label="unconfigured")
    assert change(ask, Transition.TRANSITION_CONFIGURE)
    assert change(ask, label="activate")
    assert change(ask, 99, "deactivate")  # the label counts
    managed.plan["activate"] = FAILURE
    assert not change(ask, Transition.TRANSITION_ACTIVATE)
    assert ask(GetState, "get_state").current_state == State(id=2, label="inactive")
    states = {state.id: state.label for state in ask(GetAvailableStates, "get_available_states").available_states}
    assert (len(states), states[0], states[4], states[15]) == (11, "unknown", "finalized", "errorprocessing")
    available = ask(GetAvailableTransitions, "get_available_transitions").available_transitions
    assert [(t.transition.id, t.transition.label, t.goal_state.label) for t in available] == [
        (Transition.TRANSITION_CLEANUP, "cleanup", "cleaningup"),
        (Transition.TRANSITION_ACTIVATE, "activate", "activating"),
        (Transition.TRANSITION_INACTIVE_SHUTDOWN, "shutdown", "shuttingdown"),
    ]
    graph = ask(GetAvailableTransitions, "get_transition_graph").available_transitions
    edges = {t.transition.id: (t.transition.label, t.start_state.label, t.goal_state.label) for t in graph}
    assert len(edges) == len(graph) == 25
    assert edges[Transition.TRANSITION_ON_DEACTIVATE_FAILURE] == ("transition_failure", "deactivating", "active")
    assert edges[Transition.TRANSITION_ON_SHUTDOWN_ERROR] == ("transition_error", "shuttingdown", "errorprocessing")
    assert edges[Transition.TRANSITION_ON_ERROR_ERROR] == ("transition_error", "errorprocessing", "finalized")
    assert change(ask, label="shutdown")
    assert ask(GetAvailableTransitions, "get_available_transitions").available_transitions == []


def test_a_wrong_request_is_refused(ask: Callable[..., Any], managed: Recording, genuine: bool) -> None:
    assert not change(ask, label="activate")
    if not genuine:  # which ends with an RCLError
        assert not change(ask, Transition.TRANSITION_ACTIVATE)
        assert not change(ask, 200)
    assert managed.calls == []
    assert ask(GetState, "get_state").current_state.label == "unconfigured"


def test_one_transition_at_a_time(context: Any) -> None:
    entered, leave = threading.Event(), threading.Event()

    class Slow(LifecycleNode):
        def on_configure(self, state: Any) -> Any:
            entered.set()
            return SUCCESS if leave.wait(PATIENCE_S) else ERROR

    node = Slow("slow", context=context)
    outcome: list[Any] = []
    thread = threading.Thread(target=lambda: outcome.append(node.trigger_configure()))
    thread.start()
    assert entered.wait(PATIENCE_S)
    with pytest.raises(RCLError):
        node.trigger_configure()
    with pytest.raises(RCLError):
        node.trigger_shutdown()
    leave.set()
    thread.join(PATIENCE_S)
    assert outcome == [SUCCESS]


class Counting(ManagedEntity):
    """Counts how often it was configured, and returns `outcome`."""

    def __init__(self, outcome: TransitionCallbackReturn = SUCCESS) -> None:
        self.outcome, self.configured = outcome, 0

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        self.configured += 1
        return self.outcome


def test_managed_entities(context: Any) -> None:
    node = LifecycleNode("managed", context=context)
    good = Counting()
    node.add_managed_entity(good)
    assert node.trigger_configure() == SUCCESS
    assert good.configured == 1
    node.trigger_cleanup()
    node.add_managed_entity(Counting(FAILURE))
    assert node.trigger_configure() == FAILURE
    with pytest.raises(TypeError):
        node.add_managed_entity(String())


def test_a_lifecycle_publisher_sends_while_active(node: Any, spinner: Any, context: Any) -> None:
    managed = LifecycleNode("managed", context=context)
    publisher = managed.create_lifecycle_publisher(String, "depth", 10)
    got: list[str] = []
    node.create_subscription(String, "depth", lambda message: got.append(message.data), 10)
    assert spinner.until(publisher.get_subscription_count)
    publisher.publish(String(data="too early"))
    managed.trigger_configure()
    managed.trigger_activate()
    assert publisher.is_activated
    publisher.publish(String(data="in time"))
    managed.trigger_deactivate()
    publisher.publish(String(data="too late"))
    managed.trigger_activate()
    publisher.publish(String(data="again"))
    assert spinner.until(lambda: len(got) >= 2)
    spinner.rest()
    assert got == ["in time", "again"]
    with pytest.raises(TypeError, match="publisher_class"):
        managed.create_lifecycle_publisher(String, "depth", 10, publisher_class=None)
    assert managed.destroy_lifecycle_publisher(publisher)
    assert not managed.destroy_lifecycle_publisher(publisher)
    assert managed.trigger_deactivate() == SUCCESS


def test_a_method_that_needs_an_active_entity() -> None:
    refused: list[str] = []

    class Lamp(SimpleManagedEntity):
        flashes = 0

        @SimpleManagedEntity.when_enabled(when_not_enabled=lambda: refused.append("off"))
        def flash(self, times: int) -> None:
            """Flash."""
            self.flashes += times

    lamp = Lamp()
    lamp.flash(1)
    lamp.on_activate(INACTIVE)
    lamp.flash(times=2)
    assert (lamp.flashes, refused, lamp.flash.__doc__) == (2, ["off"], "Flash.")


def test_without_services(context: Any, node: Any) -> None:
    quiet = LifecycleNode("quiet", context=context, enable_communication_interface=False)
    assert quiet.trigger_configure() == SUCCESS
    services = [name for name, _ in quiet.get_service_names_and_types_by_node("quiet", "/")]
    assert not [name for name in services if name.endswith("_state")]
    with pytest.raises(TypeError):
        LifecycleNode("wrong", context=context, enable_communication_interface="yes")


def test_the_mixin_makes_any_node_a_managed_one(context: Any) -> None:
    class Own(LifecycleNodeMixin, Node):
        def __init__(self, **options: Any) -> None:
            Node.__init__(self, "own", namespace="cell", **options)
            LifecycleNodeMixin.__init__(self, callback_group=ReentrantCallbackGroup())

    own = Own(context=context)
    executor = MultiThreadedExecutor(2, context=context)
    executor.add_node(own)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        client = own.create_client(ChangeState, "/cell/own/change_state", callback_group=ReentrantCallbackGroup())
        assert client.wait_for_service(PATIENCE_S)
        request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
        assert client.call(request).success
    finally:
        executor.shutdown()
        thread.join(PATIENCE_S)
    assert own.trigger_activate() == SUCCESS


MANAGED = """
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
rclpy.init()
class Plant(LifecycleNode):
    def on_activate(self, state):
        raise RuntimeError("no copper")
print("ready", flush=True)
try:
    rclpy.spin(Plant("plant"))
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""


def test_a_node_of_another_process(node: Any, spinner: Any, run_program: Callable[..., Any]) -> None:
    program = run_program(MANAGED)
    assert program.line() == "ready"
    events: list[str] = []
    node.create_subscription(
        TransitionEvent, "/plant/transition_event", lambda event: events.append(event.goal_state.label), 10
    )
    assert spinner.until(lambda: node.count_publishers("/plant/transition_event"))
    client = node.create_client(ChangeState, "/plant/change_state")
    assert client.wait_for_service(PATIENCE_S)
    outcomes = []
    for label in ("configure", "activate", "configure", "shutdown"):
        future = client.call_async(ChangeState.Request(transition=Transition(label=label)))
        assert spinner.until(future.done)
        outcomes.append(future.result().success)
    assert outcomes == [True, False, True, True]
    assert spinner.until(lambda: events and events[-1] == "finalized")
    assert "errorprocessing" in events


def test_short_names() -> None:
    assert (lifecycle.Node, lifecycle.State, lifecycle.NodeMixin) == (LifecycleNode, LifecycleState, LifecycleNodeMixin)
    labels = [item.to_label() for item in (SUCCESS, FAILURE, ERROR)]
    assert labels == ["transition_success", "transition_failure", "transition_error"]
