"""What commands give out: tables, progress bars, files and folders.

Tables go to stdout, progress to stderr. ``--force`` replaces files and moves folders aside.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

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

from fsw.errors import CommandError
from fsw_control.schema import files

#: width of lines if stdout is not a terminal
_ANY_WIDTH = 10_000

#: period of the lines if stderr is not a terminal
_LINE_S = 30.0

#: marks a folder that a command has made: --force moves no other one aside
_MARK = ".fsw_results"


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


def check_new(paths: Iterable[Path | None], force: bool) -> None:
    """Reject existing files before any work is done; CommandError names the first one."""
    for file in paths:
        if file is not None and file.is_dir():
            raise CommandError(f"cannot write {file}: it is a folder")
        if file is not None and file.exists() and not force:
            raise CommandError(
                f"{file} exists; choose another name, or give --force to replace it"
            )


def write_text(file: Path, text: str) -> None:
    """Write a text file, creating its folder; CommandError if that is not possible."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        files.write_whole(file, text)
    except OSError as error:
        raise CommandError(f"cannot write {file}: {error.strerror}") from None


def write_whole(file: Path, write: Callable[[Path], object]) -> None:
    """Write a file atomically, creating its folder."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with files.replacing(file) as part:
        write(part)


def write_json(file: Path | None, values: Any) -> None:
    """Write values as JSON if a file is given."""
    if file is not None:
        write_text(file, json.dumps(values, indent=2, allow_nan=False) + "\n")


def new_folder(
    arguments: argparse.Namespace,
    name: str,
    option: str = "--out",
    outputs: Collection[Path | None] = (),
) -> Path:
    """Create the folder that an option names; ``--force`` moves that of an earlier run aside.

    ``outputs``: files that other options name and this command writes, which may be in the folder.

    Raises
    ------
    CommandError
        If the folder holds something else, or an input of the command, or cannot be created.
    """
    folder: Path = getattr(arguments, option.strip("-")) or default_folder(name)
    force = getattr(arguments, "force", None)  # some commands never replace their folder
    try:
        if folder.is_dir() and any(path.name != _MARK for path in folder.iterdir()):
            ours = (folder / _MARK).exists()
            if not (ours and force):
                again = ", or give --force to keep it as the first free FOLDER_N"
                raise CommandError(
                    f"folder {folder} exists and is not empty; choose another {option}"
                    + (again if ours and force is not None else "")
                )
            if used := next(_inputs_in(folder, arguments, outputs), None):
                raise CommandError(f"--force does not move {used}, which this command reads")
            print(f"note: the earlier results are in {files.set_aside(folder)}", file=sys.stderr)
        folder.resolve().mkdir(parents=True, exist_ok=True)
        if force is not None:
            (folder / _MARK).touch()
    except OSError as error:
        raise CommandError(f"cannot make folder {folder}: {error.strerror}") from None
    return folder


def _inputs_in(
    folder: Path, arguments: argparse.Namespace, outputs: Collection[Path | None]
) -> Iterator[Path]:
    """What arguments name inside a folder, also as ``NAME=FILE``, but for outputs."""
    for value in vars(arguments).values():
        values = value if isinstance(value, list | tuple) else [value]
        for text in (str(item) for item in values if isinstance(item, str | Path)):
            for path in map(Path, {text, text.partition("=")[2]} - {""}):
                inside = folder.resolve() in path.resolve().parents
                if inside and path not in outputs and os.path.exists(path):  # False if too long
                    yield path


def listed(folder: Path) -> str:
    """Line that names a folder and the results in it."""
    names = sorted(path.name for path in folder.iterdir() if path.name != _MARK)
    return f"in {folder}: {', '.join(names)}"


def default_folder(name: str) -> Path:
    """Default folder for results."""
    return Path("out") / f"{time.strftime('%Y%m%d-%H%M%S')}_{name}"
