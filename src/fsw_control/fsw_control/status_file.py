"""The status of a process for its parent: a small JSON file, always replaced as a whole."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

from fsw_control.schema.files import write_whole

#: environment variable with the file's path, set by the parent
VARIABLE = "FSW_STATUS_FILE"


def write_status(**values: Any) -> None:
    """Replace the status, if the parent process has named a file."""
    path = os.environ.get(VARIABLE)
    if path is None:
        return
    with contextlib.suppress(OSError):  # a full disk must not end the weld
        write_whole(Path(path), json.dumps(values))


def read_status(path: Path) -> dict[str, Any]:
    """Return the last status; empty before the first one."""
    try:
        status: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    return status
