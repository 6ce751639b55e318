"""Files of the page, read once at the start, and the library of its trends, which npm installs."""

from __future__ import annotations

import asyncio
import hashlib
import sys
import threading
from pathlib import Path

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from fsw_control.schema.files import user_cache
from fsw_hmi import npm

FOLDER = Path(__file__).with_name("page")
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    "": "text/plain; charset=utf-8",
}

#: files that a page requests
FILES = ("uPlot.iife.min.js", "uPlot.min.css")
_LOOK_S = 0.05


def folder() -> Path:
    """Folder of the installation for this user and version of the lock."""
    lock = (npm.OWN / "package-lock.json").read_bytes()
    return user_cache("fsw_hmi") / hashlib.sha256(lock).hexdigest()[:12]


def install() -> Path:
    """Install it if necessary; returns the folder of ``FILES``. Raises NpmError on failure."""
    return npm.install(folder(), ["--omit=dev"]) / "uplot" / "dist"


class Uplot:
    """Files of uPlot once installed; without them the page lacks only its trends."""

    def __init__(self) -> None:
        self._files: dict[str, bytes] = {}
        self._thread = threading.Thread(target=self._read, name="uplot", daemon=True)
        self._thread.start()

    async def file(self, name: str) -> bytes | None:
        """A file; waits for the installation. None if it does not exist."""
        while self._thread.is_alive():
            await asyncio.sleep(_LOOK_S)
        return self._files.get(name)

    def _read(self) -> None:
        try:
            dist = install()
            self._files = {name: (dist / name).read_bytes() for name in FILES}
        except (npm.NpmError, OSError) as error:
            print(
                f"the page has no trends: {error}; then start it again, to install uPlot",
                file=sys.stderr,
            )


class PageFiles:
    """Routes of the page: ``/`` and ``/page/<file>``, among them uPlot as ``/page/uplot/<file>``.

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
        self._uplot = Uplot()
        if "index.html" not in self._files:
            raise ValueError(f"the page is missing: there is no {folder / 'index.html'}")
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
        data = (
            await self._uplot.file(name[6:])
            if name.startswith("uplot/")
            else self._files.get(name)
        )
        if data is None:
            return PlainTextResponse("there is no such file\n", status_code=404)
        return Response(data, media_type=_TYPES[Path(name).suffix])
