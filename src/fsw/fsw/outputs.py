"""Files and folders that a command writes: none that exists is replaced unless ``--force`` says so."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from fsw.errors import CommandError
from fsw_schema import files


def check_new(wanted: Iterable[Path | None], force: bool) -> None:
    """Refuse files that exist, before any work is done; CommandError names the first."""
    for file in wanted:
        if file is not None and file.is_dir():
            raise CommandError(f"cannot write {file}: it is a folder")
        if file is not None and file.exists() and not force:
            raise CommandError(
                f"{file} exists; choose another name, or give --force to replace it"
            )


def write_text(file: Path, text: str) -> None:
    """Write a text file, its folder first; CommandError when that is not possible."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        files.write_whole(file, text)
    except OSError as error:
        raise CommandError(f"cannot write {file}: {error.strerror}") from None


def write_whole(file: Path, write: Callable[[Path], object]) -> None:
    """Write a file that is there only when it is whole, its folder first."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with files.replacing(file) as part:
        write(part)


def write_json(file: Path | None, values: Any) -> None:
    """Write values as JSON where a file is given."""
    if file is not None:
        write_text(file, json.dumps(values, indent=2, allow_nan=False) + "\n")


def new_folder(wanted: Path | None, name: str, option: str = "--out") -> Path:
    """Make a folder for results; CommandError when it is not empty or cannot be made."""
    folder = wanted or default_folder(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise CommandError(
                f"folder {folder} exists and is not empty; nothing is overwritten, choose another {option}"
            )
    except OSError as error:
        raise CommandError(f"cannot make folder {folder}: {error.strerror}") from None
    return folder


def default_folder(name: str) -> Path:
    """Folder for results where none is given."""
    return Path("out") / f"{time.strftime('%Y%m%d-%H%M%S')}_{name}"
