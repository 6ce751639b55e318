"""The token that a person must know to command."""

from __future__ import annotations

import os
import secrets
import stat
from pathlib import Path

_SHORTEST = 8
_LONGEST_BYTES = 4096


def new() -> str:
    """A token for one run."""
    return secrets.token_urlsafe(12)


def read(path: Path) -> str:
    """The token in a file.

    Raises
    ------
    ValueError
        When there is none, or others may read or change the file; the message says what to do.
    """
    try:
        with path.open("rb") as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            content = file.read(_LONGEST_BYTES)
    except OSError as error:
        raise ValueError(f"token_file: cannot read {path}: {error.strerror}") from None
    if mode & 0o077:
        raise ValueError(f"token_file: others may read {path} (mode {mode:03o}): chmod 600 {path}")
    try:
        token = content.decode().strip()
    except UnicodeDecodeError:
        raise ValueError(f"token_file: {path} is no text") from None
    if len(token) < _SHORTEST or "\n" in token:
        raise ValueError(f"token_file: {path} must hold one line of at least {_SHORTEST} characters")
    return token
