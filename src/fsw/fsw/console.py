"""Tables on stdout."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

#: width of lines if stdout is not a terminal
_ANY_WIDTH = 10_000


def print_table(
    rows: Sequence[Sequence[str]], header: Sequence[str] = (), words: int | None = None
) -> None:
    """Print columns; plain text of any width if stdout is not a terminal.

    The first ``words`` columns are text (default: all), the others numbers, aligned to the right.
    """
    table = Table(box=None, pad_edge=False, show_header=bool(header), padding=(0, 2, 0, 0))
    for i, title in enumerate(header or [""] * len(rows[0])):
        table.add_column(
            Text(title),
            justify="right" if words is not None and i >= words else "left",
            overflow="fold",
        )
    for row in rows:
        table.add_row(*map(Text, row))
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _ANY_WIDTH
    console.print(table)


def program() -> str:
    """Program name: ``fsw`` if the package is installed, ``fsw.py`` in the repository."""
    return "fsw" if Path(sys.argv[0]).name == "fsw" else "fsw.py"
