"""Tables on stdout."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

#: of lines elsewhere than on a terminal
_ANY_WIDTH = 10_000


def print_table(rows: Sequence[Sequence[str]], header: Sequence[str] = (), numbers: bool = False) -> None:
    """Print columns; plain text of any width where stdout is no terminal.

    Parameters
    ----------
    rows : sequence of sequence of str
    header : sequence of str, optional
    numbers : bool
        Whether all columns but the first are aligned right.
    """
    table = Table(box=None, pad_edge=False, show_header=bool(header), padding=(0, 2, 0, 0))
    for column in range(len(header or rows[0]) if header or rows else 0):
        title = header[column] if header else ""
        table.add_column(title, justify="right" if numbers and column else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _ANY_WIDTH
    console.print(table)
