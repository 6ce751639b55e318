"""Managed nodes: what transitions make and destroy, how they are refused."""

import pytest
import rclpy
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from std_msgs.msg import String

from fsw_control.managed_node_ros import ManagedNode
from fsw_control.node_main_ros import run
from fsw_test_support.ros_graph import Spinner

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]


class Welder(ManagedNode):
    """Refuses what it is told to refuse, and makes one entity in each transition."""

    def __init__(self, refuses=()):
        super().__init__("welder")
        self.refuses, self.said = set(refuses), []

    def step(self, name):
        if name in self.refuses:
            self.create_publisher(String, "half", 1)
            raise ValueError(f"{name}:\n no bag")
        self.said.append(name)

    def configure(self):
        self.create_publisher(String, "made", 1)
        self.step("configure")

    def activate(self):
        self.create_timer(1.0, lambda: None)
        self.step("activate")

    def deactivate(self):
        self.step("deactivate")

    def cleanup(self):
        self.step("cleanup")


@pytest.fixture
def make():
    rclpy.init(args=[])
    nodes = []

    def subscribed(**options):
        nodes.append(Welder(**options))
        return nodes[-1]

    yield subscribed
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def entities(node):
    topics = [publisher.topic_name for publisher in node.publishers]
    return topics.count("/made"), len(list(node.timers)), topics.count("/half")


def test_transition_back_destroys_the_entities_it_created(make):
    node = make()
    before = entities(node)
    for _ in range(2):
        node.trigger_configure()
        assert entities(node) == (1, before[1], 0)
        node.trigger_activate()
        assert entities(node) == (1, before[1] + 1, 0)
        node.trigger_deactivate()
        assert entities(node) == (1, before[1], 0)
        node.trigger_cleanup()
        assert entities(node) == before
    node.trigger_configure()
    node.trigger_activate()
    node.said.clear()
    node.trigger_shutdown()
    assert (entities(node), node.said) == (before, ["deactivate", "cleanup"])


def test_a_node_that_starts_itself_raises_why_it_cannot(make):
    for refuses in ("configure", "activate"):
        with pytest.raises(ValueError, match=refuses):
            make(refuses=[refuses]).start()
    node = make()
    node.start()
    assert (node.is_configured, node.is_active) == (True, True)


def test_a_refusal_by_service_is_logged_in_one_line_and_leaves_nothing(make, capfd):
    node, spinner, peer = make(refuses=["configure"]), Spinner(), rclpy.create_node("peer")
    before = entities(node)
    spinner.executor.add_node(node)
    spinner.executor.add_node(peer)
    change = peer.create_client(ChangeState, "welder/change_state")
    state = peer.create_client(GetState, "welder/get_state")

    def ask(transition):
        return spinner.call(
            change, ChangeState.Request(transition=Transition(id=transition))
        ).success

    assert not ask(Transition.TRANSITION_CONFIGURE)
    assert (
        spinner.call(state, GetState.Request()).current_state.id
        == State.PRIMARY_STATE_UNCONFIGURED
    )
    assert entities(node) == before
    assert "cannot configure: configure: " in capfd.readouterr().err
    node.refuses.clear()
    assert ask(Transition.TRANSITION_CONFIGURE)
    node.refuses.add("activate")
    assert not ask(Transition.TRANSITION_ACTIVATE)
    assert spinner.call(state, GetState.Request()).current_state.id == State.PRIMARY_STATE_INACTIVE
    node.refuses.add("deactivate")  # nothing prevents the way back
    node.refuses.remove("activate")
    assert ask(Transition.TRANSITION_ACTIVATE) and ask(Transition.TRANSITION_DEACTIVATE)
    assert not node.is_active
    spinner.executor.shutdown()
    peer.destroy_node()


def test_a_transition_that_does_not_exist_now_does_not_end_the_node(capfd):
    """As rclpy raises it out of the service's callback."""

    class Refusing(Welder):
        def __init__(self):
            super().__init__()
            self.calls = 0
            self.create_timer(0.01, self.call)

        def call(self):
            self.calls += 1
            if self.calls > 1:
                rclpy.try_shutdown()
            else:
                raise RuntimeError(failed)

    failed = "Failed to trigger lifecycle state machine transition"  # rclpy's
    assert run(Refusing, ["welder"]) == 0
    assert f"refused: {failed}" in capfd.readouterr().err
