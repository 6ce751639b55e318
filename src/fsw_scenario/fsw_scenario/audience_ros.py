"""Who listens to a player's set-points, and whether another player sends some."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.topic_endpoint_info import TopicEndpointInfo


class Audience:
    """The subscribers of a node's ``setpoints``, of which so many are ``wanted`` to be controllers."""

    def __init__(self, node: Node, setpoints: Publisher, wanted: int) -> None:
        self._node, self._setpoints, self._wanted = node, setpoints, wanted

    def is_complete(self) -> bool:
        """Whether all that listen to set-points get them, and enough of these are controllers."""
        node, topic = self._node, self._setpoints.topic_name
        infos = node.get_subscriptions_info_by_topic(topic)
        if self._setpoints.get_subscription_count() < len(infos):
            return False
        proposals = [name for name, _ in node.get_topic_names_and_types() if name.endswith("/proposal")]
        proposing = {_node_of(info) for name in proposals for info in node.get_publishers_info_by_topic(name)}
        return len(proposing.intersection(map(_node_of, infos))) >= self._wanted

    def is_alone(self) -> bool:
        """Whether no other player sets the points of this weld; one that was killed is seen until its lease ends."""
        me = (self._node.get_namespace(), self._node.get_name())
        senders = map(_node_of, self._node.get_publishers_info_by_topic(self._setpoints.topic_name))
        return sum(sender == me for sender in senders) < 2

    def missing(self) -> str:
        """What the player waits for, in words."""
        return f"no {self._wanted} controllers listening" if self.is_alone() else "another scenario player there"


def _node_of(info: TopicEndpointInfo) -> tuple[str, str]:
    return info.node_namespace, info.node_name
