"""Output files and folders of commands: existing ones are replaced only with ``--force``."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from fsw.errors import AT_END, CommandError
from fsw_control.schema import files

#: lists what a command has put into a folder: --force replaces a folder with nothing else in it
_MARK = ".fsw_results"


def check_new(wanted: Iterable[Path | None], force: bool) -> None:
    """Reject existing files before any work is done; CommandError names the first one."""
    for file in wanted:
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
    wanted: Path | None, name: str, option: str = "--out", force: bool | None = None
) -> Path:
    """Create a folder for results; with ``force``, in place of that of an earlier run.

    None: of a command that has no ``--force``, so that none replaces its folder.

    Raises
    ------
    CommandError
        If it holds something else or cannot be created.
    """
    folder = wanted or default_folder(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        mark = folder / _MARK
        ours = (
            set(mark.read_text("utf-8", "surrogateescape").splitlines())
            if mark.is_file()
            else None
        )
        others = [] if ours is None else sorted(_content(folder) - ours)
        if any(folder.iterdir()) and (not force or ours is None or others):
            again = "" if ours is None else ", or give --force to replace it"
            again = f"; --force does not delete {others[0]}" if others else again
            raise CommandError(
                f"folder {folder} exists and is not empty; choose another {option}{again}"
            )
        for path in folder.iterdir():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    except OSError as error:
        raise CommandError(f"cannot make folder {folder}: {error.strerror}") from None
    if force is not None:
        AT_END.append(partial(_mark_filled, folder.resolve()))
    return folder


def _content(folder: Path) -> set[str]:
    """What is in a folder, but for the mark, also deep inside."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*")} - {_MARK}


def _mark_filled(folder: Path) -> None:
    """At the end of a command: list what it has put into the folder."""
    with suppress(OSError):
        (folder / _MARK).write_text(
            "\n".join(sorted(_content(folder))), "utf-8", "surrogateescape"
        )


def listed(folder: Path) -> str:
    """Line that names a folder and the results in it."""
    names = sorted(path.name for path in folder.iterdir() if path.name != _MARK)
    return f"in {folder}: {', '.join(names)}"


def default_folder(name: str) -> Path:
    """Default folder for results."""
    return Path("out") / f"{time.strftime('%Y%m%d-%H%M%S')}_{name}"
