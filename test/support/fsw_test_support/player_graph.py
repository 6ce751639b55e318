"""The scenario player among real topics."""

from __future__ import annotations

from typing import Any

import rclpy

from fsw_control import messages_ros as convert
from fsw_control.references_ros import reference_queue, subscribe_references
from fsw_control.topics_ros import LATCHED, LATEST, sensor_publishers
from fsw_msgs.msg import WeldProgress, WeldReference
from fsw_msgs.srv import OperatorRequest
from fsw_scenario.scenario_node import ScenarioNode
from fsw_test_support.ros_graph import Spinner

STEP_NS, START_NS = 100_000_000, 1_700_000_000 * 10**9


class PlayerGraph(Spinner):
    """The player, the sensors, and what a controller follows.

    Parameters
    ----------
    source : str
        Scenario that is given at start; empty: the player waits for goals.
    parameters : str
        Of the player, ``name:=value``.
    """

    def __init__(self, source: str, *parameters: str) -> None:
        words = [
            word
            for setting in ("wait_for_controllers:=0", *parameters)
            for word in ("-p", setting)
        ]
        rclpy.init(args=["test", "--ros-args", *words])
        self.player, self.peer = ScenarioNode(source), rclpy.create_node("peer")
        self.follows = reference_queue(self.peer)
        subscribe_references(self.peer, self.follows)
        self.progress: list[Any] = []
        self.peer.create_subscription(
            WeldProgress, "fsw/weld_progress", self.progress.append, LATEST
        )
        self.sensors = sensor_publishers(self.peer)
        self.by_hand = self.peer.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self.number = self.before = 0  #: of the tick, and of the last before the weld
        super().__init__()
        self.executor.add_node(self.player)
        self.executor.add_node(self.peer)
        if source:
            self.until(self.listens)

    def listens(self) -> bool:
        """Whether the player has begun."""
        return all(
            publisher.get_subscription_count()
            for publisher in (*self.sensors.values(), self.by_hand)
        )

    @property
    def weld(self) -> Any:
        """The weld under way."""
        return self.player.weld

    @property
    def in_force(self) -> Any:
        """The set-points that a controller follows."""
        return self.follows.at(START_NS + self.number * STEP_NS)

    def depth(self, number: int) -> None:
        """Publish a depth."""
        self.sensors["depth"].publish(
            convert.sensor_message("depth", 2.66, START_NS + number * STEP_NS)
        )

    def tick(self) -> Any:
        """One tick, which the player has seen at its end; returns what is then in force."""
        self.number += 1
        stamp_ns = START_NS + self.number * STEP_NS
        self.sensors["torque"].publish(convert.sensor_message("torque", 1050.0, stamp_ns))
        self.sensors["thermocouple"].publish(
            convert.sensor_message("thermocouple", 816.4, stamp_ns)
        )
        self.depth(self.number)
        weld = self.weld
        self.until(
            lambda: (
                weld.time.stamp_ns == stamp_ns
                and weld.machine.tick + weld.machine.held >= self.number - self.before
            )
        )
        return self.in_force

    def ask(self, verb: str, who: str = "") -> Any:
        """The answer of a service of the weld."""
        client = self.peer.create_client(OperatorRequest, f"fsw/weld/{verb}")
        return self.call(client, OperatorRequest.Request(who=who))

    def end(self) -> None:
        """Destroy the nodes."""
        self.executor.shutdown()
        self.player.destroy_node()
        self.peer.destroy_node()
        rclpy.try_shutdown()
