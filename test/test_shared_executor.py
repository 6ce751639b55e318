"""All nodes of a weld in one process, in one executor, as in a container."""

import threading
import time

import pytest
import rclpy
from rclpy.executors import (
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from rclpy.task import Future

from fsw_control.controller_node import ControllerNode
from fsw_control.free_domain import free_domain
from fsw_control.topics_ros import LATCHED, STREAM
from fsw_decentral import DecentralController
from fsw_msgs.msg import PlantState, WeldCommand, WeldReference
from fsw_plant.plant_node import PlantNode
from fsw_supervisor.supervisor_node import SupervisorNode
from fsw_test_support.waiting import PATIENCE_S

TICKS = 200


@pytest.mark.parametrize("make", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_a_weld_in_one_executor(make, monkeypatch):
    with free_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        parameters = [
            "fsw_plant:clock:=simulated",
            "fsw_plant:speed:=0.0",
            "fsw_plant:wait_for_subscribers:=2",
        ]
        parameters += ["fsw_supervisor:use_sim_time:=true", "fsw_decentral:use_sim_time:=true"]
        rclpy.init(
            args=["--ros-args", *(word for parameter in parameters for word in ("-p", parameter))]
        )
        try:
            check(make())
        finally:
            rclpy.try_shutdown()


def check(executor):
    truths, commands, watcher = [], [], rclpy.create_node("watcher")
    watcher.create_subscription(PlantState, "fsw/plant/truth", truths.append, STREAM)
    watcher.create_subscription(WeldCommand, "fsw/command", commands.append, STREAM)
    references = watcher.create_publisher(WeldReference, "fsw/reference", LATCHED)
    references.publish(WeldReference(depth=2.66e-3, temperature=816.4))
    decentral = ControllerNode("decentral", lambda _: DecentralController())
    nodes = [watcher, decentral, SupervisorNode(), PlantNode()]
    for node in nodes:
        executor.add_node(node)
    failed, over = [], Future()

    def spin():
        try:
            executor.spin_until_future_complete(over)
        except ExternalShutdownException:
            pass
        except Exception as error:  # for the assertion below
            failed.append(error)

    thread = threading.Thread(target=spin)
    thread.start()
    end_s = time.monotonic() + PATIENCE_S
    while len(truths) < TICKS and thread.is_alive() and time.monotonic() < end_s:
        thread.join(0.05)
    over.set_result(None)
    thread.join(PATIENCE_S)
    executor.shutdown()  # only now: rclpy's takes away what a spinning thread waits for
    for node in nodes:
        node.destroy_node()
    assert not failed
    assert len(truths) >= TICKS
    assert max(abs(truth.depth - 2.66e-3) for truth in truths) < 2e-5
    assert {command.source for command in commands[TICKS // 2 :]} == {"decentral"}
