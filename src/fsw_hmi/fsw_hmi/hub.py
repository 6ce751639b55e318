"""Queues of frames for the pages; drops pages that do not read. Runs in the server's loop."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

from fsw_hmi.control import Session

#: ticks in a frame of the past, and such frames: an hour
BLOCK, _BLOCKS = 600, 60
#: ticks that are kept at least
KEPT = BLOCK * _BLOCKS
#: ticks that wait for a page; it loses older ones
_TICKS = 20
#: answers that may wait for a page before it is dropped
_ANSWERS = 200


class History:
    """Rows of ticks in blocks, encoded once for all pages; holds an hour."""

    def __init__(self) -> None:
        self._blocks: deque[str] = deque(maxlen=_BLOCKS)
        self._rows: list[str] = []

    def add(self, row: str) -> None:
        """Take an encoded row."""
        self._rows.append(row)
        if len(self._rows) == BLOCK:
            self._blocks.append(_frame(self._rows))
            self._rows.clear()

    def frames(self) -> list[str]:
        """Frames from the newest to the oldest; rows inside are in order of time."""
        newest = [_frame(self._rows)] if self._rows else []
        return [*newest, *reversed(self._blocks)]


class Page:
    """One open page with the frames that it still has to get, the most urgent first.

    A slow page gets the newest ticks, the latest frame of every other kind, and all answers.
    ``peer`` is address and port of its browser.
    """

    def __init__(self, session: Session, peer: Any) -> None:
        self.session, self.peer = session, peer
        self.closed = False  #: by the person, not cut off
        self.superseded = False  #: another connection has resumed its session
        self.stops: list[int] = []  #: numbers of safe stops that are not answered yet
        self.given_up = asyncio.Event()  #: nothing more is to be sent
        self._wake = asyncio.Event()
        self._urgent: deque[str] = deque()
        self._latest: dict[str, str] = {}
        self._ticks: deque[str] = deque(maxlen=_TICKS)
        self._history: deque[str] = deque()

    def begin(self, hello: str, latest: dict[str, str], history: list[str]) -> None:
        """Start, or restart, with all known frames."""
        self._ticks.clear()
        self._history = deque(history)
        self._latest |= latest
        self.answer(hello)

    def answer(self, frame: str) -> None:
        """Queue an answer; answers are never dropped."""
        self._urgent.append(frame)
        if len(self._urgent) > _ANSWERS:
            self.given_up.set()
        self._wake.set()

    def tick(self, frame: str) -> None:
        """Send a tick, if the page keeps up."""
        self._ticks.append(frame)
        self._wake.set()

    def show(self, kind: str, frame: str) -> None:
        """Queue a frame; it replaces one of the same kind that has not been sent."""
        self._latest[kind] = frame
        self._wake.set()

    async def next(self) -> str:
        """The next frame to send."""
        while True:
            if self._urgent:
                return self._urgent.popleft()
            if self._latest:
                return self._latest.pop(next(iter(self._latest)))
            if self._ticks or self._history:
                return (self._ticks or self._history).popleft()
            self._wake.clear()
            await self._wake.wait()


def _frame(rows: list[str]) -> str:
    return f'{{"t":"history","rows":[{",".join(rows)}]}}'
