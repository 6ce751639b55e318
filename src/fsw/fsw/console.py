"""Tables on stdout, progress bars on stderr."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

#: width of lines if stdout is not a terminal
_ANY_WIDTH = 10_000

#: period of the lines if stderr is not a terminal
_LINE_S = 30.0


class ProgressBar(Progress):
    """Shows progress as a share or a number of pieces; a context manager."""

    def __init__(self, title: str, pieces: int | None = None) -> None:
        console = Console(stderr=True)
        counted = [MofNCompleteColumn()] if pieces else []
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TaskProgressColumn(),
            *counted,
            TimeRemainingColumn(),
        )
        super().__init__(*columns, console=console, disable=not console.is_terminal)
        self._title, self._total, self._written_s = title, pieces or 1.0, time.monotonic()
        self._task = self.add_task(title, total=self._total)

    def __call__(self, done: float) -> None:
        """Show the progress: a share, 0 to 1, or a number of pieces."""
        self.update(self._task, completed=done)
        if self.disable and time.monotonic() > self._written_s + _LINE_S:
            self._written_s = time.monotonic()
            self.console.print(
                f"{self._title}: {done / self._total:.0%}", markup=False, soft_wrap=True
            )


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
    if console.is_terminal:
        console.print(table)
        return
    console.width = _ANY_WIDTH
    with console.capture() as captured:
        console.print(table)
    print("\n".join(line.rstrip() for line in captured.get().splitlines()))
