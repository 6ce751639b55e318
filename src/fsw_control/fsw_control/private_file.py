"""Files with secrets, which no other user may read or change."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from fsw_control.schema.files import open_regular


def read_private(name: str, path: Path, longest_bytes: int = -1) -> bytes:
    """Read a secret file, at most ``longest_bytes``; ``name`` is the setting for messages.

    Raises
    ------
    ValueError
        If it cannot be read, or others can read or change it; the message gives the remedy.
    """
    try:
        with open_regular(path) as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            content = file.read(longest_bytes)
    except OSError as error:
        raise ValueError(f"{name}: cannot read {path}: {error.strerror}") from None
    if mode & 0o077:
        raise ValueError(f"{name}: others may read {path} (mode {mode:03o}): chmod 600 {path}")
    return content
