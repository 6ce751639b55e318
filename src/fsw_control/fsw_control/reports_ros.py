"""Diagnostics of a node: published, logged, and the entry of a command gate."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from fsw_control.coded import Fact, Worded, several
from fsw_control.command_gate import CommandGate
from fsw_control.diagnostic_names import HARDWARE, qualified
from fsw_control.messages_ros import header
from fsw_control.topics_ros import SENT

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

#: key of the value that distinguishes two nodes of the same name
INSTANCE = "instance"


#: key of the value that has the code of an entry
CODE = "code"


class Report(NamedTuple):
    """One entry of the diagnostics; ``level`` is a constant of ``DiagnosticStatus``."""

    part: str
    level: bytes
    what: Fact | str  #: a text comes from other software
    values: Mapping[str, object]

    @property
    def code(self) -> str:
        """Its code; empty without one."""
        return self.what.code if isinstance(self.what, Fact) else ""

    @property
    def words(self) -> str:
        """Its text."""
        return self.what.words if isinstance(self.what, Fact) else self.what

    @property
    def all_values(self) -> dict[str, object]:
        """Its values, with code and fields of the fact."""
        return {**self.values} | (told(CODE, self.what) if isinstance(self.what, Fact) else {})


class DiagnosticsPublisher:
    """Publishes a node's entries, prefixed with its namespace and ``name`` (default: the node's).

    ``instance``, if any, is a value of every entry.
    """

    def __init__(self, node: Node, name: str = "", instance: str = "") -> None:
        self._node, namespace = node, node.get_namespace()
        self._name = qualified(namespace, name or node.get_name())
        self._hardware_id = qualified(namespace, HARDWARE)
        self._values = {INSTANCE: instance} if instance else {}
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", SENT)

    def publish(self, lines: Iterable[Report], time_ns: int | None = None) -> None:
        """Publish entries with the present time, or with ``time_ns``."""
        status = []
        for line in lines:
            values = (line.all_values | self._values).items()
            entry = DiagnosticStatus(level=line.level, message=line.words)
            entry.name, entry.hardware_id = f"{self._name}: {line.part}", self._hardware_id
            entry.values = [KeyValue(key=key, value=str(value)) for key, value in values]
            status.append(entry)
        stamp_ns = self._node.get_clock().now().nanoseconds if time_ns is None else time_ns
        self._publisher.publish(DiagnosticArray(header=header(stamp_ns), status=status))


def log(node: Node, level: bytes, text: str) -> None:
    """Log a text with the severity of a diagnostic level."""
    logger = node.get_logger()
    # three calls, because rclpy refuses a change of severity at the same line of code
    if level == ERROR:
        logger.error(text)
    elif level == WARN:
        logger.warning(text)
    else:
        logger.info(text)


def told(key: str, fact: Fact | None) -> dict[str, object]:
    """Values of a fact: its code at ``key``, and its fields behind that; nested facts alike."""
    if fact is None:
        return {key: ""}
    values: dict[str, object] = {key: str(fact.code)}
    for name, item in fact.data.items():
        if isinstance(item, Fact):
            values |= told(f"{key}: {name}", item)
        elif isinstance(item, str | int | float):
            values[f"{key}: {name}"] = item
        elif type(item) is tuple:
            inside = [entry.code if isinstance(entry, Fact) else entry for entry in item]
            values[f"{key}: {name}"] = ", ".join(map(str, inside))
    return values


class Taken(Worded):
    """Commands or set-points since the last report."""

    ACCEPTED = "accepted"
    REFUSED = "{count} refused; last: {last.words}"
    PUBLISHERS = "{count} publishers: {names}"


def commands(
    gate: CommandGate, new_refusals: int, publishers: Sequence[str], unauthorised: int
) -> Report:
    """Entry of rejected commands (``new_refusals`` since the last report) and their publishers.

    Two publishers are normal for a moment during a failover; it is an error only if commands are
    also rejected as ``unauthorised``, i.e. not signed by a supervisor.
    """
    names = ", ".join(publishers)
    values: dict[str, object] = {"refused": gate.total(), **told("last refusal", gate.last)}
    values |= {f"refused: {reason}": count for reason, count in gate.refused.items()}
    values["publishers"] = names
    level, facts = OK, list[Fact]()
    if len(publishers) > 1:
        level = ERROR if unauthorised else WARN
        facts.append(Fact.of(Taken.PUBLISHERS, count=len(publishers), names=tuple(publishers)))
    if new_refusals and gate.last:
        level = max(level, WARN)
        facts.append(Fact.of(Taken.REFUSED, count=new_refusals, last=gate.last))
    return Report("commands", level, several(facts) or Fact.of(Taken.ACCEPTED), values)
