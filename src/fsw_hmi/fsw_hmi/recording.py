"""Whether the weld is on record: what the recorder reports, and when it did not."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from enum import StrEnum
from math import isfinite, nan
from pathlib import Path
from typing import Any

from fsw_hmi.frames import readable
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.recording import Note


class RecordingState(StrEnum):
    """State of the recording, as far as the page's server knows it."""

    NONE = "none"  # no recorder has reported
    RECORDING = "recording"
    INCOMPLETE = "incomplete"  # not everything gets, or has got, into the bag
    PAUSED = "paused"  # the recorder is there, but writes nothing
    FAILED = "failed"
    SILENT = "silent"  # the recorder no longer reports, its bag is open
    CLOSED = "closed"  # the bag is complete
    CLOSED_WITH_GAPS = "closed_with_gaps"  # it is closed, but lacks something


_OF_LEVEL = {
    "ok": RecordingState.RECORDING,
    "warn": RecordingState.INCOMPLETE,
    "error": RecordingState.FAILED,
}
_LACKING = {RecordingState.INCOMPLETE, RecordingState.FAILED}
#: codes of a recorder that writes nothing: by a request, or until there is something
_PAUSED = (Note.PAUSED, Note.AWAITED)
#: a recorder that ends closes its bag within this time (chosen)
_CLOSING_S = 10.0


class Recording:
    """Follows the recorder's reports.

    A bag is complete once its metadata is written, which the recorder does last; whether it is,
    is seen where the page's server shares the recorder's file system.
    """

    def __init__(self) -> None:
        self.state = RecordingState.NONE
        self._gaps: list[tuple[float, float]] = []  # that are over
        self._values: Mapping[str, str] = {}
        self._weld_s = self._recorded_s = nan  # times of the weld: now, and of the last report
        self._open_s: float | None = None  # begin of the gap that lasts
        self._missing = 0
        self._states: set[RecordingState] = set()  # that the bag of the last report has been in
        self._empty = False  # and whether it has nothing in it

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Begin and end of each gap, in the page's time of the weld [s]."""
        open_s = nan if self._open_s is None else self._open_s
        return [*self._gaps, (open_s, self._weld_s)] if self._weld_s > open_s else [*self._gaps]

    def look(self, level: str, code: str, values: Mapping[str, str], weld_s: float) -> None:
        """Take the recorder's last report: level, ``stale`` if it is old, code and values.

        ``weld_s`` is the time of the weld; NaN before the first tick.
        """
        self._weld_s = weld_s
        if level in _OF_LEVEL:
            if values.get("bag") != self._values.get("bag"):
                self._states = set()
            self._values = values
            self.state = RecordingState.PAUSED if code in _PAUSED else _OF_LEVEL[level]
            self._states.add(self.state)
            self._empty = code == Note.AWAITED
        elif self.state is not RecordingState.NONE:
            closed = _is_complete(self._values.get("bag", ""))
            self.state = RecordingState.CLOSED if closed else RecordingState.SILENT
        silent = self.state in (RecordingState.SILENT, RecordingState.FAILED)
        self._note_gap(silent or code == Note.PAUSED)
        lacks = self._states & _LACKING or self._empty or self.gaps
        if self.state is RecordingState.RECORDING and self._gaps:
            self.state = RecordingState.INCOMPLETE
        elif self.state is RecordingState.CLOSED and lacks:
            self.state = RecordingState.CLOSED_WITH_GAPS

    def _note_gap(self, is_open: bool) -> None:
        """Begin or end a gap: it lasts until a recorder records again."""
        missing = self._count("lost") + self._count("dropped")
        if is_open and (self._open_s is None or not isfinite(self._open_s)):
            self._open_s = self._recorded_s if isfinite(self._recorded_s) else self._weld_s
        elif not is_open and self._open_s is not None:
            closing = (
                self._weld_s - self._open_s <= _CLOSING_S
                and RecordingState.FAILED not in self._states
            )
            if not closing or self.state is not RecordingState.CLOSED:
                self._add_gap(self._open_s)
            self._open_s = None
        elif missing > self._missing:
            self._add_gap(self._recorded_s)
        self._missing = missing
        if not is_open:
            self._recorded_s = self._weld_s

    def _add_gap(self, begin_s: float) -> None:
        if self._gaps and self._gaps[-1][1] >= begin_s:  # messages are lost without a pause
            begin_s = self._gaps.pop()[0]
        if self._weld_s > begin_s:
            self._gaps.append((begin_s, self._weld_s))

    def _count(self, name: str) -> int:
        """A number of the report; 0 where another node sends something else."""
        text = self._values.get(name, "")
        return int(text) if text.isascii() and text.isdecimal() and len(text) < 16 else 0

    def frame(self) -> dict[str, Any]:
        """Content of the frame ``recording``; the last gap in the page's time of the weld."""
        return {
            "state": self.state,
            "bag": readable(self._values.get("bag", "")),
            "bytes": self._count("bytes") + self._count("pending_bytes"),
            "missing": self._missing,
            "gap": next(reversed(self.gaps), None),
        }


def _is_complete(bag: str) -> bool:
    """Whether a bag has its metadata.

    A path of others may be too long, odd or not ours to read.
    """
    with suppress(OSError, ValueError):
        return bool(bag) and (Path(bag) / METADATA_NAME).is_file()
    return False
