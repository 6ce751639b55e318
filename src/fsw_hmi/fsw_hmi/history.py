"""The weld so far, as frames for a page that opens."""

from __future__ import annotations

from collections import deque

#: ticks in a frame
BLOCK = 600
_BLOCKS = 60
#: ticks that are kept at least
KEPT = BLOCK * _BLOCKS


class History:
    """Rows of ticks in blocks that are encoded once, whoever asks for them; the oldest are forgotten after an hour."""

    def __init__(self) -> None:
        self._blocks: deque[str] = deque(maxlen=_BLOCKS)
        self._rows: list[str] = []
        self._newest = ""

    def add(self, row: str) -> None:
        """Take an encoded row."""
        self._rows.append(row)
        self._newest = ""
        if len(self._rows) == BLOCK:
            self._blocks.append(_frame(self._rows))
            self._rows.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._blocks.clear()
        self._rows.clear()

    def frames(self) -> list[str]:
        """Frames from the newest to the oldest; rows inside are in order of time."""
        blocks = list(reversed(self._blocks))
        if self._rows:
            self._newest = self._newest or _frame(self._rows)
            blocks.insert(0, self._newest)
        return blocks


def _frame(rows: list[str]) -> str:
    return f'{{"t":"history","rows":[{",".join(rows)}]}}'
