"""A progress bar on a terminal, else lines now and then; both on stderr."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

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
