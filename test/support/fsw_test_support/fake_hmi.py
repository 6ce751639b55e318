"""A small server of the operator's page without a graph.

A synthetic weld, and answers a test can foresee.

``python -m fsw_test_support.fake_hmi`` shows the page at http://127.0.0.1:8089 for working on it;
the token is "token".
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import sys
import threading
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from fsw_analysis.rule_book import default
from fsw_control.cause import Cause
from fsw_control.sensors import OPTIONAL
from fsw_hmi.alarm_rules import Situation
from fsw_hmi.answers import DONE, REFUSED, Answer
from fsw_hmi.control import Session
from fsw_hmi.control_room import ControlRoom
from fsw_hmi.frames import COLUMNS
from fsw_hmi.gate import Security
from fsw_hmi.headline import headline
from fsw_hmi.limits import StopProgress, limits, outside_now, reference, worst
from fsw_hmi.users import Users
from fsw_test_support.machine import free_port
from fsw_test_support.waiting import wait_until

PAGE = Path(__file__).resolve().parents[3] / "src/fsw_hmi/fsw_hmi/page"
BUILD = "test"
TOKEN = "token"
TICK_S = 0.1
_INTERLOCKS = {
    **{"interlocks.depth_high.warn": 3.4, "interlocks.depth_high.trip": 3.7},
    **{"interlocks.temperature_low.warn": 800.0, "interlocks.temperature_high.warn": 900.0},
    **{"interlocks.temperature_low.trip": 790.0, "interlocks.temperature_high.trip": 910.0},
}
SAFE = {"force_kn": 65.0, "rate_kn_per_s": 2.0}
LIMITS = limits(_INTERLOCKS, default())


def exact(value: float) -> float | None:
    """A number for JSON; None for NaN."""
    return None if math.isnan(value) else value


def weld_row(time_s: float) -> list[float]:
    """One tick of the synthetic weld.

    Waves about the paper's operating point, a set-point step every 40 s.
    """
    high = (time_s // 40.0) % 2
    aim = 2.66 + 0.08 * high
    depth = (
        aim
        - 0.08 * (2 * high - 1) * math.exp(-(time_s % 40.0) / 3.0)
        + 0.006 * math.sin(3.1 * time_s)
    )
    temperature = 816.4 + 1.2 * math.sin(time_s / 9.0) + 0.15 * math.sin(4.7 * time_s)
    force = 78.4 + 0.5 * math.sin(time_s / 7.0) + 0.8 * high
    speed = 407.6 + 2.0 * math.cos(time_s / 11.0)
    torque = 1065.0 + 6.0 * math.sin(time_s / 5.0)
    power = torque * speed * 2.0 * math.pi / 60_000.0
    return [
        time_s,
        depth,
        temperature,
        torque,
        force,
        speed,
        power,
        aim,
        816.4,
        force + 0.1,
        speed + 0.3,
        14.0 + math.sin(time_s),
        9.0 + 2.0 * math.sin(time_s / 3.0),
        143.0 * min(time_s / 600.0, 1.0),
        *(math.nan for _ in OPTIONAL),
    ]


class FakeHmi:
    """Server in a thread. Tests change ``alarms`` and the like and call :meth:`push`.

    Requests are in ``requests``.
    """

    def __init__(
        self,
        source: str = "live",
        port: int | None = None,
        bags: list[dict[str, Any]] | None = None,
        users: Users | None = None,
        handover_timeout_s: float = 30.0,
    ) -> None:
        self.source, self.bags = source, bags or []
        users = users or Users(token=TOKEN)
        self._room = ControlRoom(users, local_stop=False, handover_timeout_s=handover_timeout_s)
        self.port = port or free_port()
        self.build = BUILD
        self.silent = False  #: no frames at all, though the connection stands
        self.measuring = True  #: whether ticks come
        self.depth_offset_mm = self.temperature_offset_c = 0.0
        self.force_kn: float | None = None  #: instead of the synthetic weld's
        self.local_stop = False
        self.alarms: list[dict[str, Any]] = []
        self.account: dict[str, Any] | None = good_account()
        self.attainable: dict[str, float] | None = (
            None  #: what stands in for set-points out of reach
        )
        self.actions: list[dict[str, Any]] = []
        self.recording: dict[str, Any] = {"state": "recording", "bag": "weld/bag"}
        self.recording |= {"bytes": 12_300_000, "missing": 0, "gap": None}
        self.refusals: dict[str, str] = {}  #: request -> reason
        self.mute: set[str] = set()  #: requests that get no answer on their connection
        self.requests: list[dict[str, Any]] = []
        self.pages: list[str] = []  #: of other distributions
        self.state = _state()
        self.progress: dict[str, Any] | None = _progress()
        self.start_s = time.time() - 600.0
        self.held_s: float | None = None  #: the weld's clock, when it hardly moves
        self._sessions: dict[str, tuple[WebSocket, Session]] = {}
        self._last_tick_s = 0.0
        self._outside: dict[str, list[dict[str, Any]]] = {}
        self._stopping = StopProgress()
        self._loop: asyncio.AbstractEventLoop | None = None
        app = Starlette(
            routes=[
                Route("/", self._index),
                Route("/bags", self._bags),
                Route("/bags/{n:int}", self._bag),
                WebSocketRoute("/ws", self._socket),
                Mount("/page", StaticFiles(directory=PAGE)),
            ],
            lifespan=self._run_ticks,
        )
        self._server = uvicorn.Server(
            uvicorn.Config(
                Security(app), port=self.port, log_level="warning", ws="websockets-sansio"
            )
        )
        self._thread = threading.Thread(target=self._server.run, daemon=True)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/"

    def start(self) -> FakeHmi:
        """Serve in a thread."""
        self._thread.start()
        wait_until(lambda: self._server.started, "the server's start")
        return self

    def stop(self) -> None:
        """End the server; open connections are cut."""
        self._server.should_exit = self._server.force_exit = True
        self._thread.join()

    @property
    def holder(self) -> Session | None:
        """Who has control."""
        return self._room.holder

    def take_control(self, name: str) -> None:
        """Somebody on another page takes control that is free."""
        session = self._room.join()
        session.name = name
        request = json.dumps({"id": 1, "do": "take_control"})
        self._room.handle(session, request, time.monotonic())

    def ask_for_control(self, name: str) -> None:
        """Somebody on another page asks for control that is held."""
        session = self._room.join()
        session.name = name
        self._room.handle(session, '{"id": 1, "do": "request_control"}', time.monotonic())

    def cut(self) -> None:
        """Cut all connections, as a network does.

        No page gets a frame until ``silent`` is False again.
        """
        self.silent = True
        assert self._loop is not None
        sockets = [socket for socket, _ in self._sessions.values()]
        for socket in sockets:
            asyncio.run_coroutine_threadsafe(socket.close(1011), self._loop).result(5.0)

    def push(self) -> None:
        """Send everybody the present state, progress, alarms, control and actions."""
        assert self._loop is not None
        asyncio.run_coroutine_threadsafe(self._push(), self._loop).result(5.0)

    async def _push(self) -> None:
        for socket, session in list(self._sessions.values()):
            await self._tell(socket, session)

    async def _tell(self, socket: WebSocket, session: Session) -> None:
        control = {"t": "control", **self._room.control(session, time.monotonic())}
        reach = {"ok": True, "text": "Commands reach the machine"}
        alarms = {
            "t": "alarms",
            "alarms": self.alarms,
            "reach": reach,
            "attainable": self.attainable,
        }
        frames = [
            {"t": "state", **self.state},
            alarms,
            *([{"t": "account", **self.account}] if self.account else []),
            control,
            self._headline(),
        ]
        frames.append({"t": "actions", "actions": self.actions[-50:]})
        if self.progress:
            frames.append({"t": "progress", **self.progress})
        frames.append({"t": "recording", **self.recording})
        for frame in frames:
            await socket.send_text(json.dumps(frame))

    @contextlib.asynccontextmanager
    async def _run_ticks(self, app: Starlette) -> AsyncIterator[None]:
        self._loop = asyncio.get_running_loop()
        task = asyncio.create_task(self._ticks())
        with contextlib.suppress(asyncio.CancelledError):
            yield
        task.cancel()

    async def _ticks(self) -> None:
        count = 0
        while True:
            await asyncio.sleep(TICK_S)
            count += 1
            frames = []
            self._room.tick(time.monotonic())
            if any(
                [
                    self._room.news(session, time.monotonic())
                    for _, session in self._sessions.values()
                ]
            ):
                await self._push()
            if self.measuring:
                self._last_tick_s = time.time()
                row = self._row(self._time_s())
                shown = dict(zip(COLUMNS[1:], row[1:], strict=True))
                self._outside = outside_now(shown, self.progress, default(), LIMITS)
                values = dict(zip(COLUMNS, row, strict=True))
                stop = self._stopping.at(self.state["actual_mode"] == "safe_stop", values, SAFE)
                tick = {
                    "t": "tick",
                    "server_s": self._last_tick_s,
                    "row": list(map(exact, row)),
                    "flags": worst(self._outside),
                    "stop": stop,
                }
                frames.append(tick)
            if count % 3 == 0:
                now = time.time()
                frames.append({"t": "beat", "server_s": now, "tick_age_s": self._tick_age_s()})
                frames.append(self._headline())
            if count % 5 == 0 and self.measuring:
                frames.append(_prediction(time.time() - self.start_s))
            for socket, _ in [] if self.silent else list(self._sessions.values()):
                for frame in frames:
                    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                        await socket.send_text(json.dumps(frame))

    def _tick_age_s(self) -> float | None:
        return time.time() - self._last_tick_s if self._last_tick_s else None

    def _headline(self) -> dict[str, Any]:
        programme = self.progress["state"] if self.progress else ""
        now = Situation(
            state=self.state,
            state_age_s=0.0 if self.state["known"] else math.inf,
            programme=programme,
            tick_age_s=self._tick_age_s(),
            outside=self._outside,
        )
        shown = headline(now, self.alarms, self.account, self.recording["state"])
        return {"t": "headline", **shown}

    def _time_s(self) -> float:
        if self.held_s is None:
            return time.time() - self.start_s
        self.held_s += 1e-3
        return self.held_s

    def _row(self, time_s: float) -> list[float]:
        row = weld_row(time_s)
        row[1] += self.depth_offset_mm
        row[2] += self.temperature_offset_c
        row[4] = row[4] if self.force_kn is None else self.force_kn
        return row

    async def _socket(self, socket: WebSocket) -> None:
        await socket.accept()
        if socket.query_params.get("build") != self.build:
            await socket.send_text(json.dumps({"t": "stale", "build": self.build}))
            await socket.close(4001)
            return
        while self.silent:
            await asyncio.sleep(TICK_S)
        session = self._room.join(resume=socket.query_params.get("resume", ""))
        session.local_stop = self.local_stop
        hello = self._hello(session.id) | {"resume": session.token}
        await socket.send_text(json.dumps(hello))
        for answer in session.answers:
            await socket.send_text(answer)
        now_s = time.time() - self.start_s
        for newest in range(0, 600, 60):
            times = [now_s - newest - (600 - i) * TICK_S for i in range(600)]
            rows = [
                [exact(round(value, 4)) for value in weld_row(time_s)]
                for time_s in times
                if time_s > 0.0
            ]
            await socket.send_text(json.dumps({"t": "history", "rows": rows}))
        await self._tell(socket, session)
        self._sessions[session.id] = (socket, session)
        try:
            while True:
                request = json.loads(await socket.receive_text())
                self.requests.append(request)
                reply = self._answer(request, session)
                answer = json.dumps({"t": "answer", "id": request["id"], **reply._asdict()})
                session.answers.append(answer)
                if request["do"] in self.mute:
                    continue
                await socket.send_text(answer)
                await self._push()
        except WebSocketDisconnect:
            pass
        finally:
            if self._sessions.get(session.id) == (socket, session):
                del self._sessions[session.id]
                self._room.lose(session, time.monotonic())

    def _answer(self, request: dict[str, Any], session: Session) -> Answer:
        command = request["do"]
        if command in self.refusals:
            return Answer(REFUSED, "", self.refusals[command])
        now_s = time.monotonic()
        order = self._room.handle(session, json.dumps(request), now_s)
        if session.login:
            order = self._room.on_checked(session, self._room.check(session), now_s)
        answer = order.answer
        if order.action:
            self._act(command, request)
            answer = Answer(DONE, "", "")
        if order.asked:
            done = {"who": order.who, "action": order.asked, **answer._asdict()}
            self.actions.append({"server_s": time.time(), **done})
        return answer

    def _act(self, command: str, request: dict[str, Any]) -> None:
        if command == "safe_stop":
            self.state.update(actual_mode="safe_stop", target_mode="safe_stop", reason="operator")
        elif command == "switch":
            self.state.update(
                target_controller=request["controller"], actual_controller=request["controller"]
            )

    def _hello(self, session: str) -> dict[str, Any]:
        return {
            "t": "hello",
            "build": self.build,
            "source": "live",
            "server_s": time.time(),
            "session": session,
            "login": self._room.login,
            "columns": COLUMNS,
            "pages": self.pages,
            "limits": LIMITS,
            "reference": reference(_INTERLOCKS),
        }

    async def _index(self, request: Request) -> Response:
        text = (PAGE / "index.html").read_text(encoding="utf-8")
        text = text.replace("{{build}}", BUILD).replace("{{source}}", self.source)
        return Response(text, media_type="text/html")

    async def _bags(self, request: Request) -> Response:
        infos = [{key: value for key, value in bag.items() if key != "rows"} for bag in self.bags]
        return JSONResponse({"build": BUILD, "limits": LIMITS, "bags": infos})

    async def _bag(self, request: Request) -> Response:
        bag = self.bags[request.path_params["n"]]
        return JSONResponse(
            {"columns": [*COLUMNS, "mode", "controller", "phase", "flags"], "rows": bag["rows"]}
        )


SAFE_STOP = (
    "Safe stop: hold for 10 s: too many swaps in 30 s; "
    "nmpc failed: no proposal at the deadline, for the third time"
)


#: where a weld left its limits
PLACE = {
    **{"level": "medium", "text": "Depth error outside", "time_s": 1.0, "lasts_s": 2.0},
    **{"from_deg": 143.0, "to_deg": 144.0},
}


def good_account(*marks: dict[str, Any]) -> dict[str, Any]:
    """The judgement of a weld that keeps its limits, or of one that left them at some places."""
    good = {
        "verdict": "accept",
        "level": "good",
        "rule": "all",
        "text": "Good",
        "detail": "every limit is kept",
    }
    bad = {
        "verdict": "review",
        "level": "medium",
        "rule": "quality",
        "text": "Depth error outside",
        "detail": "once",
    }
    return (bad if marks else good) | {"marks": [*marks]}


def sample_alarms(now_s: float) -> list[dict[str, Any]]:
    """Alarms of all priorities and states."""
    return [
        _alarm(
            "safe_stop",
            SAFE_STOP,
            "high",
            "active",
            now_s - 9,
            first="Sensor thermocouple: no samples come",
        ),
        _alarm(
            "depth:stale", "Depth sensor invalid: frozen", "high", "active", now_s - 15, count=3
        ),
        _alarm(
            "temperature_high:warn",
            "Temperature above 900 °C",
            "medium",
            "active",
            now_s - 20,
            first_out=True,
        ),
        _alarm(
            "failover",
            "decentral commands in place of nmpc: nmpc was late 3 times",
            "medium",
            "active",
            now_s - 9,
        ),
        _alarm(
            "force_kn",
            "Axial force does not follow the command",
            "medium",
            "acknowledged",
            now_s - 120,
        ),
        _alarm("nmpc:late", "nmpc answers late", "low", "acknowledged", now_s - 200),
        _alarm(
            "force_high:warn",
            "Force near the limit of the drive and its load cell",
            "medium",
            "cleared",
            now_s - 90,
        ),
        _alarm(
            "node:x",
            "x no longer reports",
            "low",
            "shelved",
            now_s - 300,
            shelved_until_s=now_s + 300,
        ),
    ]


def sample_bag(n: int, duration_s: float = 240.0, shift_mm: float = 0.0) -> dict[str, Any]:
    """A recorded weld as the server tells it, with its rows."""
    rows: list[list[Any]] = []
    for i in range(int(duration_s / TICK_S)):
        row = weld_row(i * TICK_S)
        row[1] += shift_mm
        rows.append(
            [
                *(exact(round(value, 4)) for value in row),
                "auto",
                "nmpc" if i * TICK_S > 60.0 else "decentral",
                "joint_line" if i * TICK_S >= 60.0 else "start",
                {},
            ]
        )
    return {
        "n": n,
        "name": f"weld_{n}",
        "duration_s": duration_s,
        "start_s": 1_790_000_000.0,
        "controllers": ["decentral", "nmpc"],
        "events": [
            {"time_s": 60.0, "text": "swap to nmpc"},
            {"time_s": 120.0, "text": "disturbance depth +0.1 mm"},
        ],
        "account": good_account(),
        "problems": [] if n == 0 else ["3 ticks without a command"],
        "rows": rows,
    }


def _alarm(
    name: str, text: str, priority: str, state: str, raised_s: float, **changed: Any
) -> dict[str, Any]:
    label, _, why = text.partition(": ")
    return {
        **{
            "id": name,
            "text": text,
            "what": label,
            "why": why,
            "priority": priority,
            "state": state,
            "number": 1,
            "count": 1,
        },
        "consequence": "The controllers do without it for a short time only",
        "advice": "Check the sensor, then swap the controller or stop",
        "action": "check_sensor",
        "cause": "",
        **{"first_out": False, "first": "", "raised_s": raised_s},
        "first_s": raised_s - 100.0,
        **{"shelved": "anna: it is being replaced", "shelved_until_s": None},
        **changed,
    }


def _state() -> dict[str, Any]:
    health = {
        "ready": True,
        "healthy": True,
        "inhibited": False,
        "reason": "",
        "latency_max_ms": 31.0,
    }
    counts = {"missed": 0, "late": 1, "rejected": 0}
    return {
        "known": True,
        "target_controller": "nmpc",
        "actual_controller": "nmpc",
        "target_mode": "auto",
        "actual_mode": "auto",
        "reason": "nmpc is ready",
        "cause": Cause.SWAP_REQUESTED,
        "by": "operator",
        "stop_cause": 0,
        "acknowledged": False,
        "controllers": [
            {"name": "nmpc", "latency_ms": 14.0, **health, **counts},
            {"name": "decentral", "latency_ms": 2.0, **health, **counts},
        ],
        "interlocks": [],
    }


def _progress() -> dict[str, Any]:
    return {
        "state": "running",
        "phase": "joint_line",
        "angle_deg": 143.0,
        "length_mm": 1310.0,
        "time_left_s": 1660.0,
        "depth_mm": 2.66,
        "temperature_c": 816.4,
        "left": False,
        "way_back_s": 0.0,
    }


def _prediction(time_s: float) -> dict[str, Any]:
    times = [time_s + 0.4 * i for i in range(20)]
    rows = [weld_row(begin) for begin in times]
    named = {
        name: [row[COLUMNS.index(name)] for row in rows]
        for name in ("depth_mm", "temperature_c", "force_kn", "speed_rpm")
    }
    named["depth_mm:deviation"] = [0.004 + 0.0002 * i for i in range(20)]
    named["temperature_c:deviation"] = [0.5 + 0.1 * i for i in range(20)]
    return {"t": "prediction", "controller": "nmpc", "time_s": times, **named}


if __name__ == "__main__":
    arguments = sys.argv[1:]
    recorded = [sample_bag(0), sample_bag(1, shift_mm=0.02)] if "--bag" in arguments else None
    server = FakeHmi("bag" if recorded else "live", 8089, recorded).start()
    if "--alarms" in arguments:
        server.alarms = sample_alarms(time.time())
    print(server.url, flush=True)
    threading.Event().wait()
