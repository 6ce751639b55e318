"""Recorded welds on the page: columns and time line, served without graph and commands."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from fsw_analysis.headline import page_account
from fsw_analysis.judgement import judge
from fsw_analysis.procedure import recorded_parameters, rule_book
from fsw_analysis.report import labels
from fsw_analysis.rule_book import RuleBook
from fsw_analysis.signals import load_weld
from fsw_analysis.weld_signals import SIMULATED_NS, FloatArray, WeldSignals
from fsw_control.parameters import defaults
from fsw_control.sensors import OPTIONAL, SENSORS
from fsw_control.units import KW_PER_NM_RPM, NANOSECONDS
from fsw_hmi.frames import COLUMNS, SIGNALS, short
from fsw_hmi.limits import ERRORS, flags, limits
from fsw_hmi.parameters import HmiParameters
from fsw_hmi.web import PageFiles
from fsw_hmi.web_server import address, application, listen, server, tls_context
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import not_as_recorded

#: more cannot be distinguished on one chart
MOST_BAGS = 2


@dataclass(frozen=True, slots=True)
class BagView:
    """A recorded weld in the page's format, ready for JSON."""

    columns = (*COLUMNS, "mode", "controller", "phase", "flags")
    summary: dict[str, Any]  #: name, duration, events, judgement and problems
    #: one per tick, None where unknown; scenario time, with the first tick at 0.1 s
    rows: list[list[Any]]
    #: as on the live page, with the interlocks that the supervisor was recorded with
    limits: dict[str, Any]


def load(
    paths: Sequence[Path], reading: Callable[[Path], object] = lambda _: None
) -> list[BagView]:
    """Read one bag, or two to compare; ``reading`` is called before each is read.

    Raises
    ------
    BagError
        There is no such bag, it is not that of a weld, or there are too many.
    """
    if not 1 <= len(paths) <= MOST_BAGS:
        raise BagError(f"{len(paths)} bags: the page shows one, or compares {MOST_BAGS}")
    views = []
    for path, name in zip(paths, labels(paths), strict=True):
        reading(path)
        signals = load_weld(path)
        if wrong := not_as_recorded(path):
            signals.problems.append(wrong)
        views.append(view(signals, name))
    return views


def view(signals: WeldSignals, name: str) -> BagView:
    """The page's content for a weld."""
    problems = list(signals.problems)
    try:
        parameters = recorded_parameters(signals.attachments, signals.namespace, "supervisor")
    except BagError as error:
        parameters = {}
        problems.append(f"{error}: interlocks are not drawn")
    start_ns, book = int(signals.stamp_ns[0]), rule_book(signals.attachments)
    summary = {
        "name": name,
        "duration_s": round(float(signals.time_s[-1]), 3),
        "start_s": None if start_ns < SIMULATED_NS else round(start_ns / NANOSECONDS, 3),
        "controllers": [name for name in dict.fromkeys(signals.command_source) if name],
        "events": [
            {"time_s": round(event.time_s, 3), "kind": event.kind, "text": event.text}
            for event in signals.events
        ],
        "account": page_account(judge(signals, book)),
        "problems": problems,
    }
    own = limits(parameters, book)
    return BagView(summary, _rows(signals, book, own), own)


def _rows(
    signals: WeldSignals, book: RuleBook, limits: Mapping[str, Mapping[str, Any]]
) -> list[list[Any]]:
    nothing = np.full(signals.n_ticks, np.nan)
    acting = signals.drives if signals.drives is not None else signals.truth
    force_kn, speed_rpm = (
        (acting.force_kn, acting.speed_rpm) if acting is not None else (nothing, nothing)
    )
    columns = {
        **{column: getattr(signals, signal) for column, signal in SIGNALS.items()},
        **{
            (signal := SENSORS[name].signal): signals.optional.get(signal, nothing)
            for name in OPTIONAL
        },
        "force_kn": force_kn,
        "speed_rpm": speed_rpm,
        "power_kw": signals.torque_nm * speed_rpm * KW_PER_NM_RPM,
        "latency_ms": 1e3 * signals.command_latency_s,
        "solve_ms": 1e3 * _solve_time_s(signals),
    }
    numbers = [map(short, columns[name].tolist()) for name in COLUMNS[1:]]
    time_s = np.round(signals.time_s, 3).tolist()
    phases = signals.phase_names()
    for quantity, error in ERRORS.items():
        columns[error] = columns[quantity] - getattr(signals, f"programme_{quantity}")
    wrong = flags(columns, phases, book, limits)
    texts = signals.actual_mode, signals.actual_controller, phases
    return list(map(list, zip(time_s, *numbers, *texts, wrong, strict=True)))


def _solve_time_s(signals: WeldSignals) -> FloatArray:
    """Solve time of the active controller; NaN without one."""
    solve_s = np.full(signals.n_ticks, np.nan)
    for name, status in signals.statuses.items():
        chosen = signals.command_source == name
        solve_s[chosen] = status.solve_time_s[chosen]
    return solve_s


def routes(files: PageFiles, views: Sequence[BagView]) -> list[BaseRoute]:
    """Routes of the application: the page, and the bags that it shows."""
    listed = [{"n": n, **view.summary} for n, view in enumerate(views)]
    contents: dict[str, Any] = {
        "/bags": {"build": files.build, "bags": listed, "limits": views[0].limits}
    }
    for n, view in enumerate(views):
        contents[f"/bags/{n}"] = {"columns": view.columns, "rows": view.rows}

    def answer(request: Request) -> Response:  # in a thread
        return JSONResponse(contents[request.url.path])

    return [*files.routes(), *(Route(path, answer) for path in contents)]


def serve(
    bags: Sequence[Path],
    host: str | None,
    port: int | None,
    allow_hosts: Sequence[str],
    tls: tuple[str, str],
) -> int:
    """Serve the page on bags until Ctrl-C; returns the exit code.

    None: the live page's default.
    """
    standard = defaults(HmiParameters)
    host, port = host or standard["host"], standard["port"] if port is None else port
    try:
        files, encrypted = PageFiles("bag"), tls_context(*tls)
        views = load(bags, lambda path: print(f"reading {path}", flush=True))
        listening = listen(host, port)
    except (BagError, ValueError) as error:
        print(f"run_hmi.py: {error}", file=sys.stderr)
        return 2
    for view in views:
        for problem in view.summary["problems"]:
            print(f"note: {problem}", file=sys.stderr)
    app = application(routes(files, views), [host, *allow_hosts], listening.gate)
    print(f"operator's page: {address(listening, encrypted is not None)}", flush=True)
    # uvicorn ends well and then raises the signal again
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(server(app, listening.gate, encrypted).serve(sockets=[listening]))
    return 0
