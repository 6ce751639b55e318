"""The page on recorded welds: without graph, websocket and commands."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from fsw_control.parameters import defaults
from fsw_hmi.bag_view import BagView, load
from fsw_hmi.page_files import PageFiles
from fsw_hmi.parameters import HmiParameters
from fsw_hmi.web_server import address, application, listen, server, tls_context
from fsw_recorder.errors import BagError


def _encoded(content: Any) -> bytes:
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode()


def routes(files: PageFiles, views: Sequence[BagView]) -> list[BaseRoute]:
    """Routes of the application: the page, and the bags that it shows."""
    listed = [{"n": n, **view.summary} for n, view in enumerate(views)]
    bags = _encoded({"build": files.build, "bags": listed, "limits": views[0].limits})
    rows = [_encoded({"columns": view.columns, "rows": view.rows}) for view in views]

    async def on_bag(request: Request) -> Response:
        n = int(request.path_params["n"])
        if n >= len(rows):
            return PlainTextResponse(
                f"there is no bag {n}; /bags tells which there are\n", status_code=404
            )
        return Response(rows[n], media_type="application/json")

    async def on_bags(_: Request) -> Response:
        return Response(bags, media_type="application/json")

    return [*files.routes(), Route("/bags", on_bags), Route("/bags/{n:int}", on_bag)]


def serve(
    bags: Sequence[Path],
    host: str | None,
    port: int | None,
    allow_hosts: Sequence[str],
    tls: tuple[str, str],
) -> int:
    """Serve the page on bags until Ctrl-C; returns the exit code. None: the live page's default."""
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
