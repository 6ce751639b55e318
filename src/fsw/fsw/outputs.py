"""Output files and folders of commands: ``--force`` replaces files and moves folders aside."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from fsw.errors import CommandError
from fsw_control.schema import files
from fsw_recorder.recording import free_sibling

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


def new_folder(arguments: argparse.Namespace, name: str, option: str = "--out") -> Path:
    """Create the folder that an option names; ``--force`` moves that of an earlier run aside.

    Call it after all inputs have been read and checked.

    Raises
    ------
    CommandError
        If the folder holds something else, or cannot be created.
    """
    folder: Path = getattr(arguments, option.strip("-")) or default_folder(name)
    try:
        if folder.is_dir() and any(path.name != _MARK for path in folder.iterdir()):
            ours = (folder / _MARK).exists()
            if not (ours and getattr(arguments, "force", False)):
                again = ", or give --force to keep it as the first free FOLDER_N" if ours else ""
                raise CommandError(
                    f"folder {folder} exists and is not empty; choose another {option}{again}"
                )
            folder.rename(free_sibling(folder))
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _MARK).touch()
    except OSError as error:
        raise CommandError(f"cannot make folder {folder}: {error.strerror}") from None
    return folder


def listed(folder: Path) -> str:
    """Line that names a folder and the results in it."""
    names = sorted(path.name for path in folder.iterdir() if path.name != _MARK)
    return f"in {folder}: {', '.join(names)}"


def default_folder(name: str) -> Path:
    """Default folder for results."""
    return Path("out") / f"{time.strftime('%Y%m%d-%H%M%S')}_{name}"
