"""Files of the page, read once at the start, and the report on all welds, which it shows in a tab."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

FOLDER = Path(__file__).with_name("page")
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    "": "text/plain; charset=utf-8",
}
#: for the report, which is one file with its style and its pictures inside, and has no scripts
_REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)
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
        paths = sorted(
            path for path in folder.rglob("*") if path.is_file() and path.suffix in _TYPES
        )
        self._files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
        if "index.html" not in self._files:
            raise ValueError(f"the page is missing: there is no {folder / 'index.html'}")
        if _UPLOT not in self._files:
            print("the page has no trends: it was built without uPlot", file=sys.stderr)
        content = hashlib.sha256()
        for name, data in self._files.items():
            content.update(f"{name} {len(data)}\n".encode() + data)
        #: identifies the server that an open page belongs to; in index.html for ``{{build}}``
        self.build = content.hexdigest()[:12]
        index = self._files.pop("index.html").replace(b"{{build}}", self.build.encode())
        self._index = index.replace(b"{{source}}", source.encode())

    def routes(self) -> list[Route]:
        """Routes of the application."""
        return [Route("/", self._on_index), Route("/page/{name:path}", self._on_file)]

    async def _on_index(self, _: Request) -> Response:
        return Response(self._index, media_type=_TYPES[".html"])

    async def _on_file(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in self._files:
            return PlainTextResponse("there is no such file\n", status_code=404)
        return Response(self._files[name], media_type=_TYPES[Path(name).suffix])


def report_routes(file: str) -> list[Route]:
    """Route ``/all_welds`` with the report, read for every request; none without a file."""

    async def answer(_: Request) -> Response:
        return report(file)

    return [Route("/all_welds", answer)] if file else []


def report(file: str) -> Response:
    """The report, or status 404 with a remedy."""
    path = Path(file).expanduser()
    if not path.is_file():
        text = f"there is no file {path}: 'fsw.py history report' writes it\n"
        return PlainTextResponse(text, status_code=404)
    headers = {"Content-Security-Policy": _REPORT_POLICY}
    return FileResponse(path, headers=headers, media_type="text/html")
