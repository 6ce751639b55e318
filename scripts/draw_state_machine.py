#!/usr/bin/env python3
"""Draws the supervisor's state machine into its documentation.

``draw_state_machine.py [FILE ...]``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

from fsw_analysis.report import table
from fsw_supervisor.state_machine import TRANSITIONS, Mode

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "concepts" / "arbiter.md"
#: marks in the documentation between which the diagram stands
BEGIN = "<!-- generated from fsw_supervisor/state_machine.py: begin -->"
END = "<!-- generated from fsw_supervisor/state_machine.py: end -->"

_NOTES = {
    Mode.START: "holds the actual force and speed until the applied controller is known",
    Mode.AUTO: "applies the active controller's proposal, or a fallback's in the same tick",
    Mode.MANUAL: "moves to the operator's values within the move limits",
    Mode.HOLD: "repeats the last command",
    Mode.SAFE_STOP: "ramps the force down with the spindle turning, "
    "left after an acknowledgement only",
}


def mermaid_diagram() -> str:
    """State diagram in mermaid's language; arrows with the same ends are joined."""
    lines = ["stateDiagram-v2", f"    [*] --> {Mode.START}"]
    lines += [f"    {mode} : {mode}\\n{note}" for mode, note in _NOTES.items()]
    labels: dict[tuple[Mode, Mode], list[str]] = {}
    for row in TRANSITIONS:
        labels.setdefault((row.source, row.target), []).append(row.trigger.word)
    lines += [
        f"    {source} --> {target} : {' / '.join(names)}"
        for (source, target), names in labels.items()
    ]
    return "\n".join(lines)


def by_trigger() -> dict[tuple[str, str, str], list[str]]:
    """Modes from which a trigger leads to a mode, by trigger, meaning and that mode."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for row in TRANSITIONS:
        rows.setdefault((row.trigger.word, row.meaning, str(row.target)), []).append(
            str(row.source)
        )
    return rows


def svg_diagram() -> str:
    """The diagram for pages without mermaid: a line per mode.

    An arrow per trigger from the modes where it acts.
    """
    x = {str(mode): 230 + 130 * i for i, mode in enumerate(Mode)}
    height, right = 40 + 26 * len(by_trigger()), max(x.values())
    lines = [
        f'<svg viewBox="0 0 {right + 60} {height}" font-family="sans-serif" '
        'font-size="13" role="img"><title>Modes of the supervisor and their transitions</title>'
    ]
    for name, at in x.items():
        lines.append(
            f'<text x="{at}" y="16" text-anchor="middle" font-weight="bold">{name}</text>'
        )
        lines.append(f'<path d="M{at} 24V{height}" stroke="#bbb" stroke-dasharray="3 3"/>')
    for i, ((trigger, _, target), sources) in enumerate(by_trigger().items()):
        y, end = 44 + 26 * i, x[target]
        lines.append(
            f'<text x="4" y="{y + 4}" font-family="monospace" font-size="12">{trigger}</text>'
        )
        for begin in (x[source] for source in sources):
            lines.append(f'<path d="M{begin} {y}H{end}" stroke="#333" stroke-width="1.5"/>')
            lines.append(f'<circle cx="{begin}" cy="{y}" r="4" fill="#333"/>')
            side = -10 if begin < end else 10
            lines.append(f'<path d="M{end} {y}l{side} -5v10z" fill="#333"/>')
    return "".join([*lines, "</svg>"])


def transition_table() -> str:
    """The transitions as a markdown table: trigger, meaning, from, to."""
    rows = [
        (f"`{name}`", why, ", ".join(sources), to)
        for (name, why, to), sources in by_trigger().items()
    ]
    return table([("trigger", "when", "from", "to"), *rows], words=None)


def document_block() -> str:
    """What stands between the two marks in the documentation, with the marks."""
    return f"{BEGIN}\n\n```mermaid\n{mermaid_diagram()}\n```\n\n{transition_table()}\n\n{END}"


def renew_document(text: str) -> str:
    """Return ``text`` with the block between the marks renewed; ValueError if it has no marks."""
    before, _, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(f"the marks {BEGIN!r} and {END!r} are missing")
    return before + document_block() + after


def main(args: Sequence[str]) -> int:
    """Renew the files named; returns the exit code."""
    for name in args:
        path = Path(name)
        path.write_text(renew_document(path.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or [str(DOCUMENT)]))
