"""Lines of diagnostics: what nodes report of themselves, and the line that all nodes with a command gate have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus

from fsw_control.command_gate import CommandGate

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Report(NamedTuple):
    """One line of diagnostics; ``level`` is a constant of ``DiagnosticStatus``."""

    part: str
    level: bytes
    text: str
    values: Mapping[str, object]


def commands(gate: CommandGate, new_refusals: int, publishers: Sequence[str]) -> Report:
    """Commands refused (``new_refusals`` since the last report), and the nodes that publish them.

    Two publishers are normal for a moment while a standby takes over; an error only when commands are refused too.
    """
    names = ", ".join(publishers)
    values: dict[str, object] = {"refused": gate.total(), "last refusal": gate.last_refusal}
    values |= {f"refused: {reason}": count for reason, count in gate.refused.items()}
    values["publishers"] = names
    level, texts = OK, []
    if len(publishers) > 1:
        level = ERROR if new_refusals else WARN
        texts.append(f"{len(publishers)} publishers: {names}")
    if new_refusals:
        level = max(level, WARN)
        texts.append(f"{new_refusals} refused; last: {gate.last_refusal}")
    return Report("commands", level, "; ".join(texts) or "accepted", values)
