"""An operator's page that is no browser."""

from __future__ import annotations

import json
import re
import ssl
from collections.abc import Callable
from itertools import count
from typing import Any
from urllib.request import urlopen

from websockets.sync.client import connect

from fsw_test_support.waiting import PATIENCE_S

Frame = dict[str, Any]
#: of requests: a page that resumes another one's session goes on counting
_NUMBERS = count(1)


def _may_be_taken(control: Frame) -> bool:
    request = control["request"]
    return not control["holder"] or (
        request is not None and request["you"] and not request["left_s"]
    )


def build_of(url: str, trusting: ssl.SSLContext | None = None) -> str:
    """The build of the page that a server serves."""
    with urlopen(url, timeout=PATIENCE_S, context=trusting) as response:
        build = re.search(r'name="build" content="(\w+)"', response.read().decode())
    assert build is not None
    return build[1]


class Page:
    """An open page: keeps the newest frame of each kind.

    Parameters
    ----------
    url : str
        Of the server.
    build : str, optional
        By default that of the server.
    resume : str, optional
        Token of a page that was cut off.
    options
        Of the websocket.
    """

    def __init__(
        self, url: str, build: str | None = None, resume: str = "", **options: Any
    ) -> None:
        headers = {
            "origin": url.rstrip("/"),
            "max_size": None,
            "compression": None,
            "ping_interval": None,
        } | options
        self._connection = connect(
            f"{url.replace('http', 'ws')}ws?build={build or build_of(url, options.get('ssl'))}"
            f"&resume={resume}",
            **headers,
        )
        self.socket = self._connection.__enter__()
        self.frames: dict[str, Frame] = {}

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.__exit__(None, None, None)

    def receive(self, timeout_s: float = PATIENCE_S) -> Frame:
        """The next frame; TimeoutError if none comes."""
        frame: Frame = json.loads(self.socket.recv(timeout_s))
        self.frames[frame["t"]] = frame
        return frame

    def until(self, kind: str, condition: Callable[[Frame], Any] = lambda frame: True) -> Frame:
        """The next frame of a kind for which a condition holds."""
        while True:
            frame = self.receive()
            if frame["t"] == kind and condition(frame):
                return frame

    def seen(self, kind: str, condition: Callable[[Frame], Any] = lambda frame: True) -> Frame:
        """The newest frame of a kind if a condition holds for it, else the next for which it does."""
        if kind in self.frames and condition(self.frames[kind]):
            return self.frames[kind]
        return self.until(kind, condition)

    def send(self, do: str, **content: Any) -> int:
        """Send a request; returns its number."""
        number = next(_NUMBERS)
        self.socket.send(json.dumps({"id": number, "do": do, **content}))
        return number

    def ask(self, do: str, **content: Any) -> Frame:
        """Send a request and wait for its answer."""
        number = self.send(do, **content)
        return self.until("answer", lambda frame: frame["id"] == number)

    def log_in(self, secret: str, name: str = "anna") -> Frame:
        """Log in by the token or a password; returns the answer."""
        login = self.seen("hello")["login"]
        return self.ask("login", **{login: secret, "name": name})

    def command(self, secret: str, name: str = "anna") -> Page:
        """Log in and take control, whoever has it.

        When nobody gives it, after the time for an answer.
        """
        assert self.log_in(secret, name)["outcome"] == "done"
        holder = self.seen("control")["holder"]
        if holder is not None and self.ask("request_control")["outcome"] == "done":
            holder = self.seen("control", _may_be_taken)["holder"]
        taken = self.ask("take_control")
        assert taken["outcome"] == "done", taken
        return self

    def value(self, column: str) -> float | None:
        """A value of the newest tick."""
        columns = self.frames["hello"]["columns"]
        number: float | None = self.frames["tick"]["row"][columns.index(column)]
        return number
