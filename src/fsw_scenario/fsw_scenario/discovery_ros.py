"""Discovery for a player: listeners to its set-points, other players, and controllers."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.topic_endpoint_info import TopicEndpointInfo


class Discovery:
    """Subscribers of set-points and plan; expects ``wanted`` controllers with ``named`` ones.

    ``publishers`` are those of ``SetPoints``, the set-points' first.
    """

    def __init__(
        self, node: Node, publishers: Sequence[Publisher], wanted: int, named: Sequence[str] = ()
    ) -> None:
        self._node, self._publishers, self._wanted = node, publishers, wanted
        self._named = tuple(dict.fromkeys(named))
        self._topic = publishers[0].topic_name

    def is_complete(self) -> bool:
        """Whether all listeners get set-points and plan, and enough of them are controllers."""
        node = self._node
        for publisher in self._publishers:
            if publisher.get_subscription_count() < node.count_subscribers(publisher.topic_name):
                return False
        infos = node.get_subscriptions_info_by_topic(self._topic)
        proposals = [
            name for name, _ in node.get_topic_names_and_types() if name.endswith("/proposal")
        ]
        proposing = {
            _node_of(info)
            for name in proposals
            for info in node.get_publishers_info_by_topic(name)
        }
        return len(proposing.intersection(map(_node_of, infos))) >= self._wanted

    def is_alone(self) -> bool:
        """Whether no other player is present; a killed one is visible until its lease ends."""
        me = (self._node.get_namespace(), self._node.get_name())
        senders = map(_node_of, self._node.get_publishers_info_by_topic(self._topic))
        return sum(sender == me for sender in senders) < 2

    def absent(self) -> str:
        """Text about named controllers that are missing in the weld's graph; empty if none are."""
        present = self._controllers()
        lacking = [repr(name[:40]) for name in self._named if name not in present]
        if not lacking:
            return ""
        there = ", ".join(present) or "none"
        return f"no controller {', '.join(lacking)} in the graph; there: {there}"

    def _controllers(self) -> list[str]:
        pattern = re.compile(
            rf"{re.escape(self._node.get_namespace().rstrip('/'))}/fsw/(\w+)/proposal"
        )
        matches = [pattern.fullmatch(name) for name, _ in self._node.get_topic_names_and_types()]
        # the supervisor also subscribes to proposals of fallbacks that do not run
        return sorted(
            match[1] for match in matches if match and self._node.count_publishers(match[0])
        )

    def missing(self) -> str:
        """What the player waits for, as a text."""
        if not self.is_alone():
            return "another scenario player in the graph"
        return self.absent() or f"no {self._wanted} controllers listening"


def _node_of(info: TopicEndpointInfo) -> tuple[str, str]:
    return info.node_namespace, info.node_name
