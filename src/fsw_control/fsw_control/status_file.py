"""What a process tells the one that started it: a small JSON file, always replaced as a whole."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

#: environment variable with the file's path, set by whoever wants to know
VARIABLE = "FSW_STATUS_FILE"


def write_status(**values: Any) -> None:
    """Tell the process that started this one, if it has asked; what was told before is replaced."""
    path = os.environ.get(VARIABLE)
    if path is None:
        return
    part = Path(f"{path}.part")
    with contextlib.suppress(OSError):  # a full disk ends no weld
        part.write_text(json.dumps(values), encoding="utf-8")
        part.replace(path)


def read_status(path: Path) -> dict[str, Any]:
    """What was told last; empty before the first time."""
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    return found
