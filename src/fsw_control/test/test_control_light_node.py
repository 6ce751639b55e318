"""A node leaves the graph, or its process ends, whatever the middleware does."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String

from fsw_control.light_node_ros import LightNode, ends_in_time

STUCK = """
import ctypes, sys
import rclpy
from rclpy.node import Node
from fsw_control import light_node_ros

class Stuck(Node):
    def destroy_node(self):
        print("leaving", flush=True)
        while True:
            ctypes.PyDLL(None).sleep(600)  # holds the interpreter's lock, as Fast DDS does

class Ends(light_node_ros.LightNode, Stuck):
    pass

light_node_ros._LONGEST_END_S = 0.5
rclpy.init()
Ends("ends").destroy_node()
"""


@pytest.mark.usefixtures("domain_id")
def test_a_node_that_cannot_leave_ends_its_process() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    ended = subprocess.run(
        [sys.executable, "-c", STUCK],
        env=environment,
        capture_output=True,
        text=True,
        timeout=240.0,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (-signal.SIGALRM, "leaving\n"), ended.stderr


def test_the_alarm_of_others_stays() -> None:
    def others(*_: object) -> None: ...

    before = signal.signal(signal.SIGALRM, others)
    timer = signal.setitimer(signal.ITIMER_REAL, 500.0)
    try:
        with ends_in_time():
            assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
            assert 0.0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 10.0
        assert signal.getsignal(signal.SIGALRM) is others
        assert 10.0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 500.0
    finally:
        signal.setitimer(signal.ITIMER_REAL, *timer)
        signal.signal(signal.SIGALRM, before)


def test_nodes_of_tests_leave_in_time(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    left_s: list[float] = []
    monkeypatch.setattr(
        Node, "destroy_node", lambda _: left_s.append(signal.getitimer(signal.ITIMER_REAL)[0])
    )
    request.getfixturevalue("domain_id")
    Node.destroy_node(None)
    assert 0.0 < left_s[0] <= 10.0


@pytest.mark.parametrize("shut_down", [False, True])
def test_last_messages_are_delivered_before_a_node_leaves(
    domain_id: int, monkeypatch: pytest.MonkeyPatch, shut_down: bool
) -> None:
    order: list[str] = []

    class Leaving(Node):
        def destroy_node(self) -> None:
            order.append("left")
            super().destroy_node()

    class Speaker(LightNode, Leaving):
        pass

    def arrived(publisher: Publisher, timeout: Duration) -> bool:
        assert 0 < timeout.nanoseconds <= 5 * 10**9
        order.append(publisher.topic_name)
        return True

    monkeypatch.setattr(Publisher, "wait_for_all_acked", arrived)
    rclpy.init(args=[], domain_id=domain_id)
    node = Speaker("speaker", enable_rosout=False, start_parameter_services=False)
    node.create_publisher(String, "spoken", 10)
    if shut_down:
        rclpy.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    assert order == (["left"] if shut_down else ["/parameter_events", "/spoken", "left"])
