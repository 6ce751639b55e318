"""The plant as a managed node."""

import threading

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor

from fsw_control.stop import Stop
from fsw_control.topics_ros import SENT
from fsw_msgs.msg import ShoulderDepth
from fsw_msgs.srv import SetDisturbance
from fsw_test_support.waiting import PATIENCE_S

pytestmark = pytest.mark.slow


class Manager:
    """Asks the plant for transitions, as ros2 lifecycle does."""

    def __init__(self, graph):
        self.graph = graph
        self.client = graph.peer.node.create_client(ChangeState, "fsw_plant/change_state")

    def __call__(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.graph.call(self.client, request).success


def answer(graph):
    """Commands at the upper end, so that the way to the safe force is seen."""
    return lambda _, stamp: graph.peer.command(stamp, force_kn=80.0)


def test_it_ticks_while_active_and_is_safe_when_deactivated(graph, capfd):
    peer = graph.start(speed=0.0, autostart="false", connected=False, answer=answer(graph))
    change, plant = Manager(graph), graph.plant
    assert not plant.is_configured and not peer.node.count_publishers("fsw/depth")
    assert change(Transition.TRANSITION_CONFIGURE)
    graph.until(lambda: peer.node.count_publishers("fsw/depth") == 1)
    assert not peer.node.count_subscribers("fsw/command")
    assert change(Transition.TRANSITION_ACTIVATE)
    graph.until(lambda: len(peer.got["truth"]) > 30)
    assert peer.got["truth"][-1].axial_force > 79e3
    assert change(Transition.TRANSITION_DEACTIVATE)
    safe_kn = plant.get_parameter("watchdog.safe_force_kn").value
    assert plant.emulator.applied.force_kn == safe_kn
    graph.until(
        lambda: not peer.node.count_subscribers("fsw/command"), "the end of its subscription"
    )
    assert not any("set_disturbance" in name for name, _ in plant.get_service_names_and_types())
    seen = len(peer.got["truth"])
    assert change(Transition.TRANSITION_ACTIVATE)
    graph.until(lambda: len(peer.got["truth"]) > seen + 30)
    # it begins where it was left: in the safe state, until that is acknowledged
    assert peer.got["truth"][seen].axial_force == pytest.approx(1e3 * safe_kn, rel=0.01)
    assert peer.got["truth"][-1].axial_force < 66e3
    peer.stop = plant._fence.register.value
    peer.answer = lambda _, stamp: peer.command(stamp, force_kn=65.0, source="safe_stop")
    graph.until(lambda: peer.got["truth"][-1].watchdog == 0)
    peer.stop, peer.answer = Stop(plant._fence.register.value.epoch + 1, False), answer(graph)
    graph.until(lambda: peer.got["truth"][-1].axial_force > 79e3)
    assert "watchdog: " not in capfd.readouterr().err.split("deactivated")[0]
    assert change(Transition.TRANSITION_DEACTIVATE) and change(Transition.TRANSITION_CLEANUP)
    graph.until(lambda: not peer.node.count_publishers("fsw/depth"))
    assert change(Transition.TRANSITION_CONFIGURE) and change(Transition.TRANSITION_ACTIVATE)
    client = peer.node.create_client(SetDisturbance, "fsw/plant/set_disturbance")
    assert graph.call(
        client, SetDisturbance.Request(channel="depth", shape="step", amplitude=1e-4)
    ).ok
    assert change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    graph.until(lambda: not peer.node.count_publishers("fsw/depth"))


def test_it_says_why_it_cannot_be_activated_beside_another(graph, capfd):
    graph.start(autostart="false", connected=False, discovery_s=0.5)
    change, peer = Manager(graph), graph.peer
    assert change(Transition.TRANSITION_CONFIGURE)
    depths = peer.node.create_publisher(ShoulderDepth, "fsw/depth", 10)
    peer.node.create_timer(0.02, lambda: depths.publish(ShoulderDepth()))
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE))
    future = change.client.call_async(request)
    # it looks for another one while it answers, so the other one is spun elsewhere
    other = SingleThreadedExecutor()
    graph.executor.remove_node(peer.node)
    other.add_node(peer.node)
    thread = threading.Thread(target=lambda: other.spin_until_future_complete(future, PATIENCE_S))
    thread.start()
    graph.until(lambda: not thread.is_alive(), "the answer")
    assert not future.result().success
    error = capfd.readouterr().err
    assert "cannot activate: " in error and "/fsw/depth" in error
    other.shutdown()


def test_how_much_of_the_truth_is_kept_may_be_overridden(graph):
    graph.start("-p", "qos_overrides./fsw/plant/truth.publisher.depth:=3", connected=False)
    depths = {
        publisher.topic_name: publisher.qos_profile.depth for publisher in graph.plant.publishers
    }
    assert (depths["/fsw/plant/truth"], depths["/fsw/drives"]) == (3, SENT.depth)
    assert not graph.plant.has_parameter("qos_overrides./fsw/plant/truth.publisher.reliability")
