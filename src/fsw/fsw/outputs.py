"""Output files and folders of commands: ``--force`` replaces files and moves folders aside."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

from fsw.errors import CommandError
from fsw_control.schema import files

#: marks a folder that a command has made: --force moves no other one aside
_MARK = ".fsw_results"


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
                again = ", or give --force to keep it as the first free FOLDER_N" if ours else ""
                raise CommandError(
                    f"folder {folder} exists and is not empty; choose another {option}{again}"
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
