"""Files of the page."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

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
