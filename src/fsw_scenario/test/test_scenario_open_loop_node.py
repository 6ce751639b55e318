"""The open-loop controller as a node.

What it proposes is what its scenario commands, whatever is measured.
"""

import signal
import subprocess
import sys
from itertools import count

import pytest
import rclpy
from sensor_msgs.msg import Temperature

from fsw_control import Reference, weld
from fsw_control import messages_ros as convert
from fsw_control.topics_ros import LATCHED, STREAM
from fsw_msgs.msg import ShoulderDepth, SpindleTorque, WeldCommand, WeldReference
from fsw_scenario.controller_node import open_loop
from fsw_test_support.ros_graph import Spinner, domain_id
from fsw_test_support.waiting import PATIENCE_S

__all__ = ["domain_id"]
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]

SCENARIO = f"""
name: steps
duration_s: 15.0
controller: none
events:
  - {{at_s: 2.0, command: {{force_kn: {weld.FORCE_KN + 0.4}}}}}
"""


OPEN_LOOP = "import sys; from fsw_scenario.controller_node import open_loop; sys.exit(open_loop())"


@pytest.mark.full
def test_open_loop_node_proposes_the_scenarios_commands(tmp_path):
    scenario = tmp_path / "steps.yaml"
    scenario.write_text(SCENARIO)
    rclpy.init(args=[])
    peer, spinner = rclpy.create_node("peer"), Spinner()
    spinner.executor.add_node(peer)
    heard = []
    peer.create_subscription(WeldCommand, "/fsw/open_loop/proposal", heard.append, STREAM)
    sensors = [
        (peer.create_publisher(ShoulderDepth, "/fsw/depth", STREAM), "depth", 2.65),
        (peer.create_publisher(SpindleTorque, "/fsw/spindle_torque", STREAM), "torque", 1052.0),
        (peer.create_publisher(Temperature, "/fsw/thermocouple", STREAM), "thermocouple", 850.0),
    ]
    references = peer.create_publisher(WeldReference, "/fsw/reference", LATCHED)
    references.publish(
        convert.reference_message(Reference(2.66, 850.0), 0)
    )  # without one, no controller is asked
    parameters = ["-p", f"scenario:={scenario}", "-p", "from_first_tick:=true"]
    command = [sys.executable, "-c", OPEN_LOOP, "--ros-args", *parameters]
    node = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)

    stamps = count(1)

    def send():
        stamp = next(stamps) * 100_000_000
        for publisher, name, value in sensors:
            publisher.publish(convert.sensor_message(name, value, stamp))
        return stamp

    def proposes():
        send()  # again: the set-point, and word of who listens, may still be on their way
        return heard and heard[-1].healthy

    try:
        spinner.until(
            lambda: all(publisher.get_subscription_count() for publisher, *_ in sensors),
            "its sensors",
        )
        spinner.until(proposes, "a proposal")
        for _ in range(21):
            stamp = send()
            spinner.until(
                lambda stamp=stamp: convert.stamp_ns(heard[-1].header.stamp) == stamp,
                f"tick {stamp}",
            )
        node.send_signal(signal.SIGINT)
        _, log = node.communicate(timeout=PATIENCE_S)
    finally:
        node.kill()
        peer.destroy_node()
        rclpy.try_shutdown()
    forces = [convert.command(proposal).force_kn for proposal in heard if proposal.healthy]
    assert forces == sorted(forces)
    assert sorted(set(forces)) == pytest.approx([weld.FORCE_KN, weld.FORCE_KN + 0.4])
    assert node.returncode == 0 and "Traceback" not in log


def test_a_scenario_that_is_missing_ends_the_start_with_one_line(capfd):
    assert open_loop(["open_loop", "--ros-args", "-p", "scenario:=nothing_there"]) == 2
    printed = "".join(capfd.readouterr())
    assert "scenario nothing_there" in printed and printed.count("\n") == 1
