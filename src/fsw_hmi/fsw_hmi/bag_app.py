"""The page over recorded welds: no graph, no websocket, nothing to command."""

from __future__ import annotations

import argparse
import asyncio
import gzip
import json
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from fsw_hmi.bag_view import BagView, load
from fsw_hmi.page_files import PageFiles
from fsw_hmi.web_server import address, application, listen, server
from fsw_recorder.errors import BagError

_COMPRESSION = 6


class _Json:
    """An answer that never changes, encoded once."""

    def __init__(self, content: Any) -> None:
        text = json.dumps(content, separators=(",", ":"), allow_nan=False)
        self._packed = gzip.compress(text.encode(), _COMPRESSION)

    def answer(self, request: Request) -> Response:
        """The answer, packed for all that can unpack it."""
        headers = {"Vary": "Accept-Encoding"}
        if "gzip" not in request.headers.get("accept-encoding", "").lower():
            return Response(gzip.decompress(self._packed), media_type="application/json", headers=headers)
        headers["Content-Encoding"] = "gzip"
        return Response(self._packed, media_type="application/json", headers=headers)


class BagPage:
    """The page and the bags that it shows, as routes.

    Parameters
    ----------
    files : PageFiles
    views : sequence of BagView
    """

    def __init__(self, files: PageFiles, views: Sequence[BagView]) -> None:
        self._files = files
        bags = [{"n": n, **view.summary} for n, view in enumerate(views)]
        self._list = _Json({"build": files.build, "bags": bags, "limits": views[0].limits})
        self._bags = [_Json({"columns": view.columns, "rows": view.rows}) for view in views]

    def routes(self) -> list[BaseRoute]:
        """Routes of the application."""
        return [*self._files.routes(), Route("/bags", self._on_list), Route("/bags/{n:int}", self._on_bag)]

    async def _on_list(self, request: Request) -> Response:
        return self._list.answer(request)

    async def _on_bag(self, request: Request) -> Response:
        n = request.path_params["n"]
        if n >= len(self._bags):
            return PlainTextResponse(f"there is no bag {n}; /bags tells which there are\n", status_code=404)
        return self._bags[n].answer(request)


def main(args: Sequence[str] | None = None) -> int:
    """Serve the page over bags until interrupted; ``args`` as ``sys.argv``. Returns the exit code."""
    arguments = _parser().parse_args(list(sys.argv if args is None else args)[1:])
    try:
        files = PageFiles("bag")
        views = load(arguments.bag, lambda path: print(f"reading {path}", flush=True))
        listening = listen(arguments.host, arguments.port)
    except (BagError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for view in views:
        for problem in view.summary["problems"]:
            print(f"note: {problem}", file=sys.stderr)
    app = application(BagPage(files, views).routes(), [arguments.host, *arguments.allow_host])
    print(f"the page is at {address(listening)}", flush=True)
    # uvicorn ends well and then raises the signal again
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        asyncio.run(server(app).serve(sockets=[listening]))
    except KeyboardInterrupt:
        pass
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="run_hmi.py", description="Past welds on the operator's page.")
    parser.add_argument("--bag", type=Path, action="append", required=True, help="bag of a weld; twice: compare")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this computer only)")
    parser.add_argument("--port", type=int, default=8080, help="0: any free one (default: 8080)")
    parser.add_argument(
        "--allow-host", action="append", default=[], metavar="NAME", help="name under which the page may be asked for"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
