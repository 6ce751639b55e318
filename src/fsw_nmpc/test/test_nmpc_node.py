"""The NMPC among real topics.

Proposal, status and prediction at every tick, parameters at runtime, clean end.
"""

import os
import signal
import subprocess
import sys

import pytest
import rclpy
from rclpy.parameter import Parameter

from fsw_control import Command, Reference
from fsw_control import messages_ros as convert
from fsw_control.controller_node import ControllerNode
from fsw_control.topics_ros import LATCHED, STREAM, sensor_publishers
from fsw_msgs.msg import ControllerStatus, Prediction, WeldCommand, WeldReference
from fsw_nmpc import NmpcController
from fsw_nmpc.parameters import NmpcParameters
from fsw_test_support.ros_graph import Spinner
from fsw_test_support.waiting import PATIENCE_S

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]

STEP_NS = 100_000_000


@pytest.fixture
def peer(domain_id):
    rclpy.init(args=["test"])
    made = Peer()
    yield made
    made.end()


class Peer(Spinner):
    """The node, and a plant that stands still around it."""

    def __init__(self):
        self.node = ControllerNode("nmpc", NmpcController, NmpcParameters)
        self.peer = rclpy.create_node("peer")
        self.got = {"proposal": [], "status": [], "prediction": []}
        for name, kind in (
            ("proposal", WeldCommand),
            ("status", ControllerStatus),
            ("prediction", Prediction),
        ):
            self.peer.create_subscription(kind, f"/fsw/nmpc/{name}", self.got[name].append, STREAM)
        self.sensors = sensor_publishers(self.peer)
        self.references = self.peer.create_publisher(WeldReference, "/fsw/reference", LATCHED)
        self.commands = self.peer.create_publisher(WeldCommand, "/fsw/command", STREAM)
        super().__init__()
        self.executor.add_node(self.node)
        self.executor.add_node(self.peer)
        outputs = (*self.sensors.values(), self.references, self.commands)
        self.until(lambda: all(publisher.get_subscription_count() for publisher in outputs))
        self.until(
            lambda: all(self.peer.count_publishers(f"/fsw/nmpc/{name}") for name in self.got)
        )
        self.references.publish(convert.reference_message(Reference(2.66, 816.4), 0))

    def tick(self, k):
        """Publish the sensors of tick ``k``; returns the answer once all of it is here."""
        count = {name: len(messages) for name, messages in self.got.items()}
        stamp = k * STEP_NS
        for name, value in (("depth", 2.66), ("torque", 1052.86), ("thermocouple", 816.4)):
            self.sensors[name].publish(convert.sensor_message(name, value, stamp))
        self.commands.publish(convert.command_message(Command(78.4, 407.576), stamp, "decentral"))
        self.until(
            lambda: (
                len(self.got["proposal"]) > count["proposal"]
                and len(self.got["status"]) > count["status"]
            )
        )
        return self.got["proposal"][-1]

    def tick_until_healthy(self, k):
        for tick in range(k, k + 20):
            if self.tick(tick).healthy:
                return tick
        raise AssertionError(self.got["proposal"][-1].why)

    def end(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.peer.destroy_node()
        rclpy.try_shutdown()


def test_proposal_status_and_prediction(peer):
    k = peer.tick_until_healthy(1)
    proposal = peer.tick(k + 1)
    assert proposal.source == "nmpc"
    assert proposal.axial_force == pytest.approx(78.4e3, abs=100.0)
    peer.until(lambda: peer.got["prediction"])
    status = peer.got["status"][-1]
    assert "solved" in status.solver_status
    assert status.iterations > 0
    assert status.solve_time > 0.0
    assert len(peer.got["prediction"][-1].depth) == 54


def test_parameters_at_runtime(peer):
    k = peer.tick_until_healthy(1)
    before = peer.tick(k + 1)
    changes = [
        Parameter("preset", value="paper"),
        Parameter("calmness", value=2.0),
        Parameter("priority", value="balance"),
    ]
    assert all(result.successful for result in peer.node.set_parameters(changes))
    refused = peer.node.set_parameters([Parameter("calmness", value=33.0)])[0]
    assert not refused.successful
    assert "calmness" in refused.reason
    after = peer.tick(k + 2)
    assert after.healthy
    assert after.axial_force == pytest.approx(before.axial_force, abs=100.0)
    peer.node.controller.finish_changes()
    assert peer.tick(k + 3).healthy
    assert peer.node.controller.library.horizon.n_blocks == 54


def test_process_logs_its_solver_and_exits_cleanly():
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-m", "fsw_nmpc.nmpc_node", "--ros-args", "-p", "preset:=paper"]
    with subprocess.Popen(
        command, env=environment, stderr=subprocess.STDOUT, stdout=subprocess.PIPE, text=True
    ) as node:
        line = node.stdout.readline()
        node.send_signal(signal.SIGINT)
        rest, _ = node.communicate(timeout=PATIENCE_S)
    assert "solver: rti, 54 blocks" in line
    assert node.returncode == 0, rest


def test_wrong_parameter_is_one_line_and_exit_code():
    command = [sys.executable, "-m", "fsw_nmpc.nmpc_node", "--ros-args", "-p", "calmness:=33.0"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert run.returncode == 2
    assert "calmness" in run.stderr
    assert "Traceback" not in run.stderr
