"""Finds the controllers in the graph and subscribes to their topics."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

from rclpy.node import Node

from fsw_control.topics_ros import STREAM
from fsw_msgs.msg import ControllerStatus, WeldCommand
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.parameters import NAME, RESERVED


class ControllerTopics:
    """Subscribes to proposals and status of every controller, i.e. node that publishes proposals.

    ``registry`` records joining and leaving controllers; ``on_proposal`` and ``on_status`` get the
    controller's name and its message, ``on_controller`` the name of each new one.
    """

    def __init__(
        self,
        node: Node,
        registry: ControllerRegistry,
        on_proposal: Callable[[str, WeldCommand], None],
        on_status: Callable[[str, ControllerStatus], None],
        on_controller: Callable[[str], None],
    ) -> None:
        self.ignored: set[str] = set()  #: names of publishers that cannot be controllers
        self._node, self._registry = node, registry
        self._on_proposal, self._on_status = on_proposal, on_status
        self._on_controller = on_controller
        self._subscribed: set[str] = set()
        self._prefix = node.resolve_topic_name("fsw/command").removesuffix("command")
        self._proposal_topic = re.compile(re.escape(self._prefix) + rf"({NAME})/proposal\Z")

    def look(self) -> None:
        """Record which controllers are in the graph; call it a few times a second."""
        for topic, types in self._node.get_topic_names_and_types():
            match = self._proposal_topic.match(topic)
            if match is None:
                continue
            name = match[1]
            if name in RESERVED or types != ["fsw_msgs/msg/WeldCommand"]:
                if name not in self.ignored:
                    self.ignored.add(name)
                    why = "reserved name, or not of type fsw_msgs/msg/WeldCommand"
                    self._node.get_logger().error(f"{topic} is ignored: {why}")
            elif self._node.count_publishers(topic):
                self.subscribe(name)
                self._registry.join(name)
            else:
                self._registry.leave(name)

    def subscribe(self, name: str) -> None:
        """Subscribe to a controller's topics, once."""
        if name in self._subscribed:
            return
        self._subscribed.add(name)
        create = self._node.create_subscription
        create(WeldCommand, f"fsw/{name}/proposal", partial(self._on_proposal, name), STREAM)
        create(ControllerStatus, f"fsw/{name}/status", partial(self._on_status, name), STREAM)
        self._on_controller(name)

    def proposers(self, name: str) -> int:
        """Number of publishers of a controller's proposals; more than one share its name."""
        return self._node.count_publishers(f"{self._prefix}{name}/proposal")
