"""What is sent to which page, and when a page is given up. Runs in the web server's loop only."""

from __future__ import annotations

import asyncio
from collections import deque

from fsw_hmi.history import History

#: ticks that wait for a page; it loses older ones
_TICKS = 20
#: kinds of frames that do not belong to one weld
_LASTING = ("state", "alarms")
#: answers that wait for a page before it is given up
_ANSWERS = 200


class Client:
    """What one page still has to get, the most urgent first.

    Of ticks a slow page gets the newest, of every other kind of frame the latest; it loses no answer.

    Attributes
    ----------
    given_up : asyncio.Event
        Set when nothing more is to be sent.
    """

    def __init__(self) -> None:
        self.given_up = asyncio.Event()
        self._wake = asyncio.Event()
        self._urgent: deque[str] = deque()
        self._latest: dict[str, str] = {}
        self._ticks: deque[str] = deque(maxlen=_TICKS)
        self._history: deque[str] = deque()
        self._sending_since_s: float | None = None

    def begin(self, hello: str, latest: dict[str, str], history: list[str]) -> None:
        """Start, or start again, with everything that is known."""
        self._urgent.append(hello)
        self._ticks.clear()
        self._history = deque(history)
        self._latest |= latest
        self._wake.set()

    def answer(self, frame: str) -> None:
        """Send an answer, whatever else is lost."""
        self._urgent.append(frame)
        if len(self._urgent) > _ANSWERS:
            self.given_up.set()
        self._wake.set()

    def tick(self, frame: str) -> None:
        """Send a tick, if the page keeps up."""
        self._ticks.append(frame)
        self._wake.set()

    def show(self, kind: str, frame: str) -> None:
        """Send a frame in place of one of this kind that has not been sent."""
        self._latest[kind] = frame
        self._wake.set()

    async def next(self) -> str:
        """The next frame to send."""
        self._sending_since_s = None
        while True:
            if self._urgent:
                frame = self._urgent.popleft()
            elif self._latest:
                frame = self._latest.pop(next(iter(self._latest)))
            elif self._ticks:
                frame = self._ticks.popleft()
            elif self._history:
                frame = self._history.popleft()
            else:
                self._wake.clear()
                await self._wake.wait()
                continue
            self._sending_since_s = asyncio.get_running_loop().time()
            return frame

    def give_up_if_stuck(self, patience_s: float) -> None:
        """Give the page up when it has not taken a frame for so long."""
        since_s = self._sending_since_s
        if since_s is not None and asyncio.get_running_loop().time() - since_s > patience_s:
            self.given_up.set()


class Hub:
    """All open pages, and what a new page is sent."""

    def __init__(self) -> None:
        self.clients: set[Client] = set()
        self.history = History()
        self._hello = ""
        self._latest: dict[str, str] = {}

    def tick(self, row: str, frame: str | None) -> None:
        """Keep a row, and send its frame to all pages unless it is left out."""
        self.history.add(row)
        if frame is not None:
            for client in self.clients:
                client.tick(frame)

    def show(self, kind: str, frame: str, keep: bool = True) -> None:
        """Send a frame to all pages, and with ``keep`` to those that open later."""
        if keep:
            self._latest[kind] = frame
        for client in self.clients:
            client.show(kind, frame)

    def forget(self) -> None:
        """Another weld begins: the past does not belong to it, but who is there and what is wrong does."""
        self.history.clear()
        self._latest = {kind: frame for kind, frame in self._latest.items() if kind in _LASTING}

    def latest(self) -> dict[str, str]:
        """Latest frames for a new page, by kind."""
        return dict(self._latest)
