"""The nodes that publish commands, and the sources that are accepted in consequence."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence

from rclpy.node import Node

from fsw_control.command_gate import CommandGate
from fsw_control.contract import BUILT_IN_SOURCES
from fsw_control.topics_ros import LATEST
from fsw_msgs.msg import SupervisorState

#: number of supervisors that are remembered, latest first
_SUPERVISORS = 10
#: rmw's name for a node that it has not discovered yet
_NAME_UNKNOWN = "_NODE_NAME_UNKNOWN_"


class CommandWriters:
    """Restricts the gate to the supervisor's sources while other nodes publish commands, too.

    ``gate`` returns the gate, which may be replaced. If ``configured`` returns sources, only
    those are accepted.
    """

    def __init__(
        self, node: Node, gate: Callable[[], CommandGate], configured: Callable[[], Sequence[str]]
    ) -> None:
        self.names: list[str] = []  #: nodes that publish commands, as of the last :meth:`look`
        self._node, self._gate, self._configured = node, gate, configured
        self._told: set[str] = set()
        self._announced: tuple[str, ...] = ()
        self._elected: deque[str] = deque(maxlen=_SUPERVISORS)
        self._refused: Counter[str] = Counter()
        self._unknown: Counter[str] = Counter()
        node.create_subscription(
            SupervisorState, "fsw/supervisor/state", self._on_supervisor, LATEST
        )

    def look(self) -> None:
        """Determine the publishers of commands; call it a few times per second."""
        publishers = self._node.get_publishers_info_by_topic("fsw/command")
        names = sorted(info.node_name for info in publishers)
        if names != self.names:
            self.names = names
            self.set_sources()
        known = {name for name in names if name != _NAME_UNKNOWN}
        if len(names) > 1 and len(known) == len(set(names)) and not known <= self._told:
            self._told |= known
            text = f"{len(names)} publishers of fsw/command: {', '.join(names)}"
            self._node.get_logger().warning(text)

    def set_sources(self) -> None:
        """Update the gate, also after the configured sources have changed."""
        sources = tuple(self._configured())
        self._gate().sources = self._announced if not sources and len(self.names) > 1 else sources

    def note_refused(self, leader: str) -> None:
        """Note a rejected command that was signed by the supervisor ``leader``."""
        self._refused[leader] += 1

    def unauthorised(self) -> int:
        """Rejected commands since the last call that no elected supervisor has signed.

        During a failover the commands of the old and the new leader overlap for a moment. A
        supervisor that has just taken over has until the next call to announce itself.
        """
        refused, self._refused = self._refused, Counter()
        late, self._unknown = self._unknown, Counter({key: refused[key] for key in refused if key})
        return refused[""] + sum(count for key, count in late.items() if key not in self._elected)

    def _on_supervisor(self, message: SupervisorState) -> None:
        identity = message.leader
        if identity and identity not in self._elected:
            self._elected.append(identity)
        self._announced = (*(record.name for record in message.controllers), *BUILT_IN_SOURCES)
        self.set_sources()
