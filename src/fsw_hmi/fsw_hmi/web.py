"""The live page as a web application: pages come and go, requests in, frames out."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from fsw_hmi.control_room import REFUSED, TIMED_OUT, ControlRoom, Session, Verdict
from fsw_hmi.frames import COLUMNS, frame
from fsw_hmi.hub import Client, Hub
from fsw_hmi.page_files import PageFiles
from fsw_hmi.requests import Action, SafeStop, Switch
from fsw_hmi.security import client_of

BEAT_S = 0.25
#: how much longer than the graph may take an answer is waited for, should the node itself be stuck
_MARGIN_S = 2.0
_KEPT_ACTIONS = 50
#: requests of one page that wait for the graph; a safe stop always may
_MOST_PENDING = 20
_STALE, _POLICY, _TRY_LATER = 4001, 1008, 1013


@dataclass(frozen=True, slots=True)
class Order:
    """An action on its way to the graph, or what became of one that never got there.

    Attributes
    ----------
    number : int
        By which the outcome is reported; 0: only for the record.
    who : str
        Name and session.
    asked : str
        The action in words.
    action : Action or None
        None: only for the record.
    outcome, message : str
        For the record.
    """

    number: int
    who: str
    asked: str
    action: Action | None = None
    outcome: str = ""
    message: str = ""


@dataclass(slots=True)
class _Pending:
    page: _Page
    ids: list[int]
    order: Order
    timer: asyncio.TimerHandle


@dataclass(eq=False, slots=True)
class _Page:
    session: Session
    client: Client
    pending: int = 0


class LivePage:
    """The page over a running weld. All methods but the constructor belong to the server's loop.

    Parameters
    ----------
    files : PageFiles
    room : ControlRoom
    deliver : callable
        Takes an :class:`Order`; called in the server's thread.
    request_timeout_s : float
        What the graph may take for an answer.
    patience_s : float
        After which a page that takes nothing is given up.
    max_pages : int
        Of one client.
    """

    def __init__(
        self,
        files: PageFiles,
        room: ControlRoom,
        deliver: Callable[[Order], None],
        request_timeout_s: float,
        patience_s: float,
        max_pages: int,
    ) -> None:
        self._files, self._room, self._deliver = files, room, deliver
        self._request_timeout_s, self._patience_s, self._max_pages = request_timeout_s, patience_s, max_pages
        self._hub = Hub()
        self._pages: set[_Page] = set()
        self._hello: dict[str, Any] = {}
        self._pending: dict[int, _Pending] = {}
        self._orders = 0
        self._actions: deque[dict[str, Any]] = deque(maxlen=_KEPT_ACTIONS)
        self._tick_s: float | None = None

    def routes(self) -> list[BaseRoute]:
        """Routes of the application."""
        return [*self._files.routes(), WebSocketRoute("/ws", self._on_open)]

    # ---------------------------------------------------------------- from the graph

    def set_hello(self, hello: Mapping[str, Any]) -> None:
        """Take the first frame of new pages; open pages are restarted with it."""
        self._hello = dict(hello)
        for page in self._pages:
            self._begin(page)

    def forget(self) -> None:
        """Another weld begins."""
        self._hub.forget()
        for page in self._pages:
            self._begin(page)

    def restore(self, rows: list[str], actions: list[dict[str, Any]]) -> None:
        """Go on with rows and actions of a server before; to be called before the first page."""
        for row in rows:
            self._hub.history.add(row)
        self._actions.extend(actions)

    def tick(self, row: str, text: str | None, came_s: float) -> None:
        """Take an encoded row and its frame (None: not sent); ``came_s`` on ``time.monotonic``."""
        self._tick_s = came_s
        self._hub.tick(row, text)

    def show(self, kind: str, text: str) -> None:
        """Take an encoded frame that replaces the one of this kind before."""
        self._hub.show(kind, text)

    def on_outcome(self, number: int, outcome: str, message: str) -> None:
        """Take what became of an order; only the first time counts."""
        pending = self._pending.pop(number, None)
        if pending is None:
            return
        pending.timer.cancel()
        pending.page.pending -= 1
        for request in pending.ids:
            self._answer(pending.page, request, outcome, message)
        self._record(pending.order.who, pending.order.asked, outcome, message)

    async def beat(self) -> None:
        """Tell all pages four times a second that the server is alive, for as long as it is."""
        while True:
            age_s = None if self._tick_s is None else round(time.monotonic() - self._tick_s, 3)
            self._hub.show("beat", frame("beat", {"server_s": _now_s(), "tick_age_s": age_s}), keep=False)
            for page in self._pages:
                page.client.give_up_if_stuck(self._patience_s)
            await asyncio.sleep(BEAT_S)

    # ---------------------------------------------------------------- one page

    async def _on_open(self, socket: WebSocket) -> None:
        await socket.accept()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it may be gone at any time
            if socket.query_params.get("build") != self._files.build:
                await socket.send_text(frame("stale", {"build": self._files.build}))
                await socket.close(_STALE)
            else:
                await self._serve(socket, socket.client.host if socket.client else "")

    async def _serve(self, socket: WebSocket, address: str) -> None:
        client = client_of(address)
        if sum(page.session.client == client for page in self._pages) >= self._max_pages:
            await socket.close(_TRY_LATER, f"{self._max_pages} pages are open already on this computer")
            return
        page = _Page(self._room.join(address), Client())
        self._pages.add(page)
        self._hub.clients.add(page.client)
        self._begin(page)
        jobs = [
            asyncio.create_task(job)
            for job in (_send(socket, page.client), self._listen(socket, page), page.client.given_up.wait())
        ]
        try:
            await asyncio.wait(jobs, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._pages.discard(page)
            self._hub.clients.discard(page.client)
            for job in jobs:
                job.cancel()
            await asyncio.gather(*jobs, return_exceptions=True)
            if self._room.leave(page.session):
                self._show_control()

    def _begin(self, page: _Page) -> None:
        hello = {
            "build": self._files.build,
            "source": "live",
            "server_s": _now_s(),
            "session": page.session.id,
            "columns": COLUMNS,
            **self._hello,
        }
        latest = self._hub.latest() | {
            "control": frame("control", self._room.control(page.session)),
            "actions": frame("actions", {"actions": list(self._actions)}),
        }
        page.client.begin(frame("hello", hello), latest, self._hub.history.frames())

    async def _listen(self, socket: WebSocket, page: _Page) -> None:
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            verdict = self._room.handle(page.session, message.get("text"), time.monotonic())
            if verdict.close:  # the answer before, not in the queue
                if verdict.id is not None:
                    await socket.send_text(_answer(verdict.id, verdict.outcome, verdict.message))
                await socket.close(_POLICY, "too many bad requests")
                return
            self._carry_out(page, verdict)

    def _carry_out(self, page: _Page, verdict: Verdict) -> None:
        session = page.session
        if verdict.control:
            self._show_control()
        if verdict.action is not None and verdict.id is not None:
            self._order(page, verdict.id, verdict.action, verdict.asked)
            return
        if verdict.id is not None:
            self._answer(page, verdict.id, verdict.outcome, verdict.message)
        if verdict.asked:
            self._record(session.who, verdict.asked, verdict.outcome, verdict.message)
            self._deliver(Order(0, session.who, verdict.asked, outcome=verdict.outcome, message=verdict.message))

    def _order(self, page: _Page, request: int, action: Action, asked: str) -> None:
        if isinstance(action, SafeStop):
            for under_way in self._pending.values():
                if under_way.page is page and under_way.order.action == action:
                    under_way.ids.append(request)  # the graph is asked once
                    return
        elif page.pending >= _MOST_PENDING:
            self._answer(page, request, REFUSED, "too many requests wait for an answer")
            return
        self._orders += 1
        order = Order(self._orders, page.session.who, asked, action)
        wait_s = self._request_timeout_s + _MARGIN_S + (action.wait_s if isinstance(action, Switch) else 0.0)
        timer = asyncio.get_running_loop().call_later(
            wait_s, partial(self.on_outcome, order.number, TIMED_OUT, f"no answer within {wait_s:g} s")
        )
        page.pending += 1
        self._pending[order.number] = _Pending(page, [request], order, timer)
        self._deliver(order)

    def _answer(self, page: _Page, request: int, outcome: str, message: str) -> None:
        page.client.answer(_answer(request, outcome, message))

    def _record(self, who: str, asked: str, outcome: str, message: str) -> None:
        self._actions.append(
            {"server_s": _now_s(), "who": who, "action": asked, "outcome": outcome, "message": message}
        )
        self._hub.show("actions", frame("actions", {"actions": list(self._actions)}), keep=False)

    def _show_control(self) -> None:
        for page in self._pages:
            page.client.show("control", frame("control", self._room.control(page.session)))


async def _send(socket: WebSocket, client: Client) -> None:
    while True:
        await socket.send_text(await client.next())


def _answer(request: int, outcome: str, message: str) -> str:
    return frame("answer", {"id": request, "outcome": outcome, "message": message})


def _now_s() -> float:
    return round(time.time(), 3)
