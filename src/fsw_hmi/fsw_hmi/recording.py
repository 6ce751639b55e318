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


class RecordingState(StrEnum):
    """State of the recording, as far as the page's server knows it."""

    NONE = "none"  # no recorder has reported
    RECORDING = "recording"
    INCOMPLETE = "incomplete"  # not everything gets into the bag
    FAILED = "failed"
    SILENT = "silent"  # the recorder no longer reports, its bag is open
    CLOSED = "closed"  # the bag is complete


_OF_LEVEL = {
    "ok": RecordingState.RECORDING,
    "warn": RecordingState.INCOMPLETE,
    "error": RecordingState.FAILED,
}


class Recording:
    """Follows the recorder's reports; ``gaps`` are begin and end, in the page's time of the weld [s].

    A bag is complete once its metadata is written, which the recorder does last; whether it is,
    is seen where the page's server shares the recorder's file system.
    """

    def __init__(self) -> None:
        self.state = RecordingState.NONE
        self.gaps: list[tuple[float, float]] = []
        self._values: Mapping[str, str] = {}
        self._heard_s = nan  # time of the weld of the last report that is not old
        self._missing = 0

    def look(self, level: str, values: Mapping[str, str], weld_s: float) -> None:
        """Take the recorder's last report, ``stale`` if it is old, at a time of the weld."""
        was_silent = self.state is RecordingState.SILENT
        if level in _OF_LEVEL:
            self.state, self._values = _OF_LEVEL[level], values
        elif self.state is not RecordingState.NONE:
            closed = _is_complete(self._values.get("bag", ""))
            self.state = RecordingState.CLOSED if closed else RecordingState.SILENT
        missing = self._count("lost") + self._count("dropped")
        if was_silent:  # it lasts until the recorder, or another one, reports again
            self.gaps[-1] = self.gaps[-1][0], weld_s
        elif self.state is RecordingState.SILENT or missing > self._missing:
            begin_s = self._heard_s if isfinite(self._heard_s) else weld_s
            if self.gaps and self.gaps[-1][1] == begin_s:  # messages are lost without a pause
                begin_s = self.gaps.pop()[0]
            self.gaps.append((begin_s, weld_s))
        self._missing = missing
        if level in _OF_LEVEL:
            self._heard_s = weld_s

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
            "gap": self.gaps[-1] if self.gaps else None,
        }


def _is_complete(bag: str) -> bool:
    """Whether a bag has its metadata; a path of others may be too long, odd or not ours to read."""
    with suppress(OSError, ValueError):
        return bool(bag) and (Path(bag) / METADATA_NAME).is_file()
    return False
