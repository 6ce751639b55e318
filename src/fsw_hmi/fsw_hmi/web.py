"""Web application of the page: its files; on the live page, requests of pages in, frames out."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from fsw_control.coded import Fact
from fsw_control.schema.errors import InputError
from fsw_hmi.answers import Answer, Loss
from fsw_hmi.control import Session
from fsw_hmi.control_room import ControlRoom, Order
from fsw_hmi.frames import COLUMNS, frame
from fsw_hmi.hub import History, Page
from fsw_hmi.requests import SafeStop

FOLDER = Path(__file__).with_name("page")
#: what draws the trends; ``npm_packages.py`` gets it when the page is built
_UPLOT = "uplot/uPlot.iife.min.js"


class PageFiles:
    """Routes of the page: ``/`` and ``/page/<file>``.

    ``source`` is what the page shows, ``live`` or ``bag``; it learns this from ``{{source}}`` in
    its index.html.

    Raises
    ------
    ValueError
        When there is no index.html.
    """

    def __init__(self, source: str, folder: Path = FOLDER) -> None:
        index = folder / "index.html"
        if not index.is_file():
            raise ValueError(f"the page is missing: there is no {index}")
        if not (folder / _UPLOT).is_file():
            print("the page has no trends: it was built without uPlot", file=sys.stderr)
        content = hashlib.sha256()
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            data = path.read_bytes()
            content.update(f"{path.relative_to(folder)} {len(data)}\n".encode() + data)
        #: identifies the server that an open page belongs to; in index.html for ``{{build}}``
        self.build, self._folder = content.hexdigest()[:12], folder
        text = index.read_text(encoding="utf-8").replace("{{build}}", self.build)
        self._index = text.replace("{{source}}", source)

    def routes(self) -> list[BaseRoute]:
        """Routes of the application."""
        return [Route("/", self._on_index), Mount("/page", StaticFiles(directory=self._folder))]

    async def _on_index(self, _: Request) -> Response:
        return HTMLResponse(self._index)


#: kinds of frames that do not belong to one weld
_LASTING = ("state", "alarms", "actions")
_STALE, _POLICY = 4001, 1008
_NICE = 10
#: codes of a page that is closed or left; any other is a connection that was lost
_CLOSED = (1000, 1001)


class LivePage:
    """The page over a running weld. All methods but the constructor belong to the server's loop.

    ``deliver`` takes an :class:`Order`, in the server's thread; ``touch`` address and port of a
    page on which somebody has asked for something, and whether a user has logged in there;
    ``pages`` the HTML of further pages, by name.
    """

    def __init__(
        self,
        files: PageFiles,
        room: ControlRoom,
        deliver: Callable[[Order], None],
        touch: Callable[[Any, bool], None] = lambda _peer, _known: None,
        pages: Mapping[str, Callable[[], str]] = MappingProxyType({}),
    ) -> None:
        self._files, self._room, self._deliver, self._touch = files, room, deliver, touch
        self._further = pages
        # one thread: a flood of logins takes no more of the processor
        self._logins = ThreadPoolExecutor(1, "login", _step_back)
        self._checking: asyncio.Task[None] | None = None
        self._pages: set[Page] = set()
        self._history = History()
        self._latest: dict[str, str] = {}  # frames for a new page, by kind
        self._hello: dict[str, Any] = {}
        self._tick_s: float | None = None
        self._closed = False

    def routes(self) -> list[BaseRoute]:
        """Routes of the application."""
        further = Route("/pages/{name}", self._on_further)
        return [*self._files.routes(), further, WebSocketRoute("/ws", self._on_open)]

    # ---------------------------------------------------------------- from the graph

    def set_hello(self, hello: Mapping[str, Any]) -> None:
        """Set the first frame of new pages; open pages restart with it."""
        self._hello = dict(hello)
        self._begin(*self._pages)

    def forget(self) -> None:
        """Start a new weld: discard the rows of the last one."""
        self._history = History()
        # who is there and what is wrong does not belong to one weld
        self._latest = {kind: text for kind, text in self._latest.items() if kind in _LASTING}
        self._begin(*self._pages)

    def tick(self, row: str, text: str | None, came_s: float) -> None:
        """Take an encoded row and its frame (None: not sent); ``came_s`` on ``time.monotonic``."""
        self._tick_s = came_s
        self._history.add(row)
        if text is not None:
            for page in self._pages:
                page.tick(text)

    def show(self, kind: str, text: str) -> None:
        """Take an encoded frame that replaces the one of this kind before."""
        self._latest[kind] = text
        for page in self._pages:
            page.show(kind, text)

    def withdraw(self, kind: str) -> None:
        """Show new pages no frame of this kind."""
        self._latest.pop(kind, None)

    def beat(self) -> None:
        """Send a heartbeat to all pages; call several times a second."""
        self._look_at_control()
        age_s = None if self._tick_s is None else round(time.monotonic() - self._tick_s, 3)
        beat = frame("beat", {"server_s": _now_s(), "tick_age_s": age_s})
        for page in self._pages:
            page.show("beat", beat)

    def _look_at_control(self) -> None:
        for record in self._room.tick(time.monotonic()):
            self._deliver(record)
        self._show_control()

    # ---------------------------------------------------------------- one page

    async def _on_further(self, request: Request) -> Response:
        make = self._further.get(request.path_params["name"])
        if make is None:
            return PlainTextResponse("there is no such page\n", 404)
        if not self._room.admits(request.query_params.get("ticket", "")):
            return PlainTextResponse("log in first\n", 403)
        try:
            return HTMLResponse(await run_in_threadpool(make))
        except InputError as error:
            return PlainTextResponse(f"{error}\n", 404)
        except Exception as error:  # another distribution's: it may fail in any way
            return PlainTextResponse(f"the page cannot be made: {error!r}\n", 500)

    async def _on_open(self, socket: WebSocket) -> None:
        await socket.accept()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it may be gone at any time
            if socket.query_params.get("build") != self._files.build:
                await socket.send_text(frame("stale", {"build": self._files.build}))
                await socket.close(_STALE)
            else:
                await self._serve(socket, socket.client.host if socket.client else "")

    async def _serve(self, socket: WebSocket, address: str) -> None:
        session = self._room.join(address, socket.query_params.get("resume", ""))
        for before in self._pages:  # the end of its connection has not been noticed yet
            if before.session is session:
                before.superseded = True
                before.given_up.set()
        page = Page(session, socket.client)
        if session.name:  # a user's page that was cut off: the new connection is a user's, too
            self._touch(page.peer, True)
        self._pages.add(page)
        self._begin(page)
        for text in session.answers:  # it takes those that it waits for
            page.answer(text)
        ends = _send(socket, page), self._listen(socket, page), page.given_up.wait()
        jobs = [asyncio.create_task(job) for job in ends]
        try:
            await asyncio.wait(jobs, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for job in jobs:
                job.cancel()
            await asyncio.gather(*jobs, return_exceptions=True)
            self._pages.discard(page)  # only now: until here its session may be resumed
            if page.superseded:
                pass  # the session is another page's now, whatever became of this one
            elif self._closed or page.closed:
                code = Loss.SERVER_ENDED if self._closed else Loss.PAGE_CLOSED
                self._room.leave(page.session, Fact.of(code))
            else:
                self._room.lose(page.session, time.monotonic())
            self._show_control()

    def _begin(self, *pages: Page) -> None:
        for page in pages:
            hello = {
                "build": self._files.build,
                "source": "live",
                "server_s": _now_s(),
                "session": page.session.id,
                "resume": page.session.token,
                "login": self._room.login,
                "columns": COLUMNS,
                "pages": [*self._further],
                **self._hello,
            }
            page.session.known = {}
            page.begin(frame("hello", hello), self._latest, self._history.frames())
        self._show_control()

    async def _listen(self, socket: WebSocket, page: Page) -> None:
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                page.closed = message.get("code") in _CLOSED
                return
            order = self._room.handle(page.session, message.get("text"), time.monotonic())
            if order.close:  # the answer before, not in the queue
                if order.id is not None:
                    await socket.send_text(_answer(order.id, order.answer))
                page.closed = True
                await socket.close(_POLICY, "too many bad requests")
                return
            self._carry_out(page, order)
            if page.session.login and (self._checking is None or self._checking.done()):
                self._checking = asyncio.create_task(self._check_logins())

    async def _check_logins(self) -> None:
        """Check the passwords that wait without delaying other requests, above all a safe stop."""
        room, loop = self._room, asyncio.get_running_loop()
        while (session := room.next_login()) is not None:
            user = None
            with contextlib.suppress(MemoryError, ValueError, RuntimeError):  # or at the end
                user = await loop.run_in_executor(self._logins, room.check, session)
            order = room.on_checked(session, user, time.monotonic())
            for page in [*self._pages]:
                if page.session is session and not page.superseded:
                    self._carry_out(page, order)

    def end(self) -> None:
        """Prepare for the server closing all pages."""
        self._closed = True

    def close(self) -> None:
        """Stop checking passwords, and record the loss of control."""
        self._logins.shutdown(wait=False, cancel_futures=True)
        self._look_at_control()

    def _carry_out(self, page: Page, order: Order) -> None:
        self._touch(page.peer, bool(page.session.name))
        self._show_control()
        if order.action is not None and order.id is not None:
            self._order(page, order.id, order)
            return
        if order.id is not None and order.answer.outcome:
            self._reply(page.session, order.id, order.answer)
        if order.asked:
            self._deliver(order)

    def _order(self, page: Page, request: int, order: Order) -> None:
        ids = [request]
        if isinstance(order.action, SafeStop):
            page.stops.append(request)
            ids = page.stops
            if len(ids) > 1:
                return  # the graph is asked once

        def reply(answer: Answer) -> None:
            """Take the outcome; only the first one counts."""
            for number in ids:
                self._reply(page.session, number, answer)
            ids.clear()

        self._deliver(replace(order, reply=reply))

    def _reply(self, session: Session, request: int, answer: Answer) -> None:
        """Answer a request, on whichever connection its page has now or resumes its session."""
        text = _answer(request, answer)
        session.answers.append(text)
        for page in self._pages:
            if page.session is session:
                page.answer(text)

    def _show_control(self) -> None:
        """Send changes of control to the pages that they concern."""
        for page in self._pages:
            if page.superseded:  # news are told once a session, and are the new page's
                continue
            control = self._room.news(page.session, time.monotonic())
            if control is not None:
                page.show("control", frame("control", control))


def _step_back() -> None:
    """Lower this thread's priority, so that control goes first; Linux has priorities by thread."""
    with contextlib.suppress(OSError):
        nice = min(19, os.getpriority(os.PRIO_PROCESS, 0) + _NICE)
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), nice)


async def _send(socket: WebSocket, page: Page) -> None:
    while True:
        await socket.send_text(await page.next())


def _answer(request: int, answer: Answer) -> str:
    return frame("answer", {"id": request, **answer._asdict()})


def _now_s() -> float:
    return round(time.time(), 3)
