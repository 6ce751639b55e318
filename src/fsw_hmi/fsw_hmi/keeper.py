"""State that survives a restart of the page's server: a JSON file and a file of trend rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, TextIO

from pydantic import Field, TypeAdapter, ValidationError

from fsw_control.schema.files import read_regular, write_whole
from fsw_hmi.alarms import Entry
from fsw_hmi.frames import COLUMNS
from fsw_hmi.hub import KEPT

#: older state belongs to another weld [s] (chosen)
_OLD_S = 600.0


@dataclass(slots=True)
class Kept:
    """State of the page; ``now_s`` and ``wall_s``: steady and wall clock when it was saved.

    ``holder`` had control then; ``ended`` are the fields of the last loss of control.
    """

    now_s: float
    wall_s: float
    alarms: dict[str, Entry] = field(default_factory=dict)
    actions: list[dict[str, str | float]] = field(default_factory=list)
    holder: str = ""
    ended: dict[str, str | float] = field(default_factory=dict)


_KEPT: TypeAdapter[Kept] = TypeAdapter(Kept)
_Value = Annotated[float, Field(allow_inf_nan=False)] | None
_ROW: TypeAdapter[list[_Value]] = TypeAdapter(
    Annotated[list[_Value], Field(min_length=len(COLUMNS), max_length=len(COLUMNS))]
)


class Keeper:
    """Keeps state and rows in a folder; does nothing without a folder (None) or if the disk fails.

    The state is replaced as a whole. Rows are appended: a kill loses those since the last
    :meth:`keep`. ``warn`` gets a line, once each, that says why nothing can be kept, and why what
    was kept before is not used.
    """

    def __init__(self, folder: Path | None, warn: Callable[[str], object]) -> None:
        self._folder, self._warn = folder, warn
        self._file: TextIO | None = None

    def load(self, wall_s: float) -> tuple[Kept | None, list[str]]:
        """State and rows of the previous server; empty if missing, damaged or of another weld."""
        if self._folder is None:
            return None, []
        path, state, rows = self._folder / "hmi_state.json", None, list[str]()
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if path.exists():
                state = _KEPT.validate_json(read_regular(path))
                if not 0.0 <= wall_s - state.wall_s <= _OLD_S:
                    self._warn(f"{path}: kept by the page of another weld, not used")
                    state = None
                else:
                    rows = self._rows(self._folder / "hmi_rows.jsonl")
        except ValidationError:
            self._warn(f"{path}: damaged, not used")
        except OSError as error:
            self._give_up(error)
        self.forget(rows)
        return state, rows

    def _rows(self, path: Path) -> list[str]:
        text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
        lines = text.splitlines()
        rows = [line for line in lines if _is_row(line)]
        if len(rows) < len(lines):
            self._warn(f"{path}: {len(lines) - len(rows)} damaged lines, left out")
        return rows[-KEPT:]

    def forget(self, rows: Sequence[str] = ()) -> None:
        """Start a new weld with these rows."""
        if self._folder is None:
            return
        try:
            if self._file is not None:
                self._file.close()
            self._file = (self._folder / "hmi_rows.jsonl").open("w", encoding="utf-8")
            self._file.writelines(f"{row}\n" for row in rows)
        except OSError as error:
            self._give_up(error)

    def add(self, row: str) -> None:
        """Take a row of the trends, encoded."""
        if self._file is not None:
            try:
                self._file.write(f"{row}\n")
            except OSError as error:
                self._give_up(error)

    def keep(self, state: Kept) -> None:
        """Write the state, and the rows so far."""
        if self._folder is None or self._file is None:
            return
        try:
            self._file.flush()
            write_whole(self._folder / "hmi_state.json", _KEPT.dump_json(state))
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self._warn(f"{self._folder}: {error.strerror}: nothing survives a restart of the page")
        self._folder = self._file = None


def _is_row(line: str) -> bool:
    try:
        row = _ROW.validate_json(line, strict=True)
    except ValidationError:
        return False
    return row[0] is not None
