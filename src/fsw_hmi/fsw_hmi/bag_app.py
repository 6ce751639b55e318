"""The page on recorded welds: without graph, websocket and commands."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from fsw_control.parameters import defaults
from fsw_hmi.bag_view import BagView, load
from fsw_hmi.page_files import PageFiles
from fsw_hmi.parameters import HmiParameters
from fsw_hmi.web_server import address, application, listen, server, tls_context
from fsw_recorder.errors import BagError


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
