"""Figures of an exploration.

Rows in a JSON file, and tables between marks of a page of ``docs/results``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

Row = dict[str, Any]

PAGES = Path(__file__).resolve().parents[3] / "docs" / "results"


def load(file: Path) -> list[Row]:
    """The rows of a file; none if it does not exist."""
    rows: list[Row] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
    return rows


def save(row: Row, file: Path, key: Sequence[str]) -> None:
    """Put a row into a file, instead of the one with the same values of ``key``."""
    rows = [other for other in load(file) if any(other[name] != row[name] for name in key)]
    file.write_text(json.dumps([*rows, row], indent=1), encoding="utf-8")


def publish(name: str, mark: str, text: str) -> None:
    """Replace what stands between ``<!-- mark -->`` and ``<!-- end of mark -->`` in the page of a name."""
    begin, end = f"<!-- {mark} -->", f"<!-- end of {mark} -->"
    page = PAGES / name
    before, _, after = page.read_text(encoding="utf-8").partition(begin)
    _, _, after = after.partition(end)
    page.write_text(f"{before}{begin}\n\n{text}\n{end}{after}", encoding="utf-8")
