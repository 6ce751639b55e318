"""Output files and folders of commands: existing ones are replaced only with ``--force``."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from fsw.errors import AT_END, CommandError
from fsw_control.schema import files

#: lists what a command has put into a folder: --force replaces a folder with nothing else in it
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
    """Create the folder that an option names; ``--force`` first empties that of an earlier run.

    Call it after all inputs have been read and checked. ``outputs``: files that other options
    name and this command writes, which may be in the folder.

    Raises
    ------
    CommandError
        If the folder holds something else, or an input of the command, or cannot be created.
    """
    folder = getattr(arguments, option.strip("-")) or default_folder(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        check_folder(arguments, folder, option, outputs)
        for path in folder.iterdir():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    except OSError as error:
        raise CommandError(f"cannot make folder {folder}: {error.strerror}") from None
    return folder


def check_folder(
    arguments: argparse.Namespace,
    folder: Path,
    option: str = "--out",
    outputs: Collection[Path | None] = (),
) -> None:
    """Reject a folder that may not be replaced; at the end list what the command has put into it.

    Raises
    ------
    CommandError
        As of :func:`new_folder`.
    """
    force = getattr(arguments, "force", None)  # some commands never replace their folder
    mark = folder / _MARK
    ours = set(mark.read_text("utf-8", "surrogateescape").splitlines()) if mark.is_file() else None
    others = [] if ours is None else sorted(_content(folder) - ours)
    if folder.is_dir() and any(folder.iterdir()) and (not force or ours is None or others):
        again = "" if ours is None else ", or give --force to replace it"
        again = f"; --force does not delete {others[0]}" if others else again
        raise CommandError(
            f"folder {folder} exists and is not empty; choose another {option}{again}"
        )
    if used := next(_inputs_in(folder, arguments, outputs), None):
        raise CommandError(f"--force does not delete {used}, which this command reads")
    if force is not None:
        AT_END.append(partial(_mark_filled, folder.resolve()))


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


def _content(folder: Path) -> set[str]:
    """What is in a folder, but for the mark, also deep inside."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*")} - {_MARK}


def _mark_filled(folder: Path) -> None:
    """At the end of a command: list what it has put into the folder, if there is anything."""
    with suppress(OSError):
        if content := _content(folder):
            (folder / _MARK).write_text("\n".join(sorted(content)), "utf-8", "surrogateescape")


def listed(folder: Path) -> str:
    """Line that names a folder and the results in it."""
    names = sorted(path.name for path in folder.iterdir() if path.name != _MARK)
    return f"in {folder}: {', '.join(names)}"


def default_folder(name: str) -> Path:
    """Default folder for results."""
    return Path("out") / f"{time.strftime('%Y%m%d-%H%M%S')}_{name}"
