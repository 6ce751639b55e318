"""Who listens to a player's set-points, whether another player sends some, and which controllers there are."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.topic_endpoint_info import TopicEndpointInfo


class Audience:
    """Who subscribes to set-points and to their plan: so many controllers are ``wanted``, among them those ``named``.

    ``publishers`` are those of ``SetPoints``, that of the set-points first.
    """

    def __init__(
        self, node: Node, publishers: Sequence[Publisher], wanted: int, named: Sequence[str] = ()
    ) -> None:
        self._node, self._publishers, self._wanted, self._named = (
            node,
            publishers,
            wanted,
            tuple(dict.fromkeys(named)),
        )
        self._topic = publishers[0].topic_name

    def is_complete(self) -> bool:
        """Whether all that listen get set-points and plan, and enough of these are controllers."""
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
        """Whether no other player sets the points of this weld; one that was killed is seen until its lease ends."""
        me = (self._node.get_namespace(), self._node.get_name())
        senders = map(_node_of, self._node.get_publishers_info_by_topic(self._topic))
        return sum(sender == me for sender in senders) < 2

    def absent(self) -> str:
        """Which of the named controllers are not in the weld's graph, and which are, in words; empty: all are."""
        present = self._controllers()
        lacking = [repr(name[:40]) for name in self._named if name not in present]
        if not lacking:
            return ""
        return f"no controller {', '.join(lacking)} in the graph; there: {', '.join(present) or 'none'}"

    def _controllers(self) -> list[str]:
        pattern = re.compile(
            rf"{re.escape(self._node.get_namespace().rstrip('/'))}/fsw/(\w+)/proposal"
        )
        found = [pattern.fullmatch(name) for name, _ in self._node.get_topic_names_and_types()]
        # the supervisor also subscribes to the proposals of its fallbacks that do not run
        return sorted(one[1] for one in found if one and self._node.count_publishers(one[0]))

    def missing(self) -> str:
        """What the player waits for, in words."""
        if not self.is_alone():
            return "another scenario player in the graph"
        return self.absent() or f"no {self._wanted} controllers listening"


def _node_of(info: TopicEndpointInfo) -> tuple[str, str]:
    return info.node_namespace, info.node_name
