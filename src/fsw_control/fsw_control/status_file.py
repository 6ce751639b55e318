"""The status of a process for the one that started it: a small JSON file, always replaced as a whole."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

from fsw_schema.files import write_whole

#: environment variable with the file's path, set by the process that starts another
VARIABLE = "FSW_STATUS_FILE"


def write_status(**values: Any) -> None:
    """Replace the status, where the process that started this one has named a file."""
    path = os.environ.get(VARIABLE)
    if path is None:
        return
    with contextlib.suppress(OSError):  # a full disk ends no weld
        write_whole(Path(path), json.dumps(values))


def read_status(path: Path) -> dict[str, Any]:
    """The last status; empty before the first."""
    try:
        status: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    return status
