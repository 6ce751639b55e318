"""Diagnostics of a node: their lines, how they are published and logged, and the line of a command gate."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from fsw_control.command_gate import CommandGate
from fsw_control.diagnostic_names import HARDWARE, qualified
from fsw_control.messages_ros import header
from fsw_control.topics_ros import SENT

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

#: value that tells two nodes of one name apart
INSTANCE = "instance"


class Report(NamedTuple):
    """One line of diagnostics; ``level`` is a constant of ``DiagnosticStatus``."""

    part: str
    level: bytes
    text: str
    values: Mapping[str, object]


class DiagnosticsPublisher:
    """Publishes the lines of a node, with its namespace and ``name`` before each; by default the node's.

    ``instance``, if there is one, is a value of every line.
    """

    def __init__(self, node: Node, name: str = "", instance: str = "") -> None:
        self._node, namespace = node, node.get_namespace()
        self._name = qualified(namespace, name or node.get_name())
        self._hardware_id = qualified(namespace, HARDWARE)
        self._values = {INSTANCE: instance} if instance else {}
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", SENT)

    def publish(self, lines: Iterable[Report], time_ns: int | None = None) -> None:
        """Publish lines of now, or of ``time_ns``."""
        status = [
            DiagnosticStatus(
                level=line.level,
                name=f"{self._name}: {line.part}",
                message=line.text,
                hardware_id=self._hardware_id,
                values=[
                    KeyValue(key=key, value=str(value))
                    for key, value in ({**line.values} | self._values).items()
                ],
            )
            for line in lines
        ]
        stamp_ns = self._node.get_clock().now().nanoseconds if time_ns is None else time_ns
        self._publisher.publish(DiagnosticArray(header=header(stamp_ns), status=status))


def log(node: Node, level: bytes, text: str) -> None:
    """Log a text with the severity of a diagnostic level."""
    logger = node.get_logger()
    # three calls, because rclpy refuses a line of code that changes its severity
    if level == ERROR:
        logger.error(text)
    elif level == WARN:
        logger.warning(text)
    else:
        logger.info(text)


def commands(
    gate: CommandGate, new_refusals: int, publishers: Sequence[str], unauthorised: int
) -> Report:
    """Commands refused (``new_refusals`` since the last report), and the nodes that publish them.

    Two publishers are normal for a moment while a standby takes over; an error only when commands
    are refused too that are ``unauthorised``: not of a supervisor.
    """
    names = ", ".join(publishers)
    values: dict[str, object] = {"refused": gate.total(), "last refusal": gate.last_refusal}
    values |= {f"refused: {reason}": count for reason, count in gate.refused.items()}
    values["publishers"] = names
    level, texts = OK, []
    if len(publishers) > 1:
        level = ERROR if unauthorised else WARN
        texts.append(f"{len(publishers)} publishers: {names}")
    if new_refusals:
        level = max(level, WARN)
        texts.append(f"{new_refusals} refused; last: {gate.last_refusal}")
    return Report("commands", level, "; ".join(texts) or "accepted", values)
