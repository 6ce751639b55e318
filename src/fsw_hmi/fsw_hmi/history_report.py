"""The report on all welds before, which the page shows in a tab of its own."""

from __future__ import annotations

from pathlib import Path

from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

#: the report is one file with its style and its pictures inside, and has no scripts
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)


class HistoryReport:
    """A file as the route ``/all_welds``; it is read anew for every request.

    Parameters
    ----------
    file : str
        HTML file; empty: there is no such route.
    """

    def __init__(self, file: str) -> None:
        self._file = Path(file).expanduser() if file else None

    def routes(self) -> list[Route]:
        """Routes of the application."""
        return [Route("/all_welds", self.answer)] if self._file else []

    async def answer(self, _: Request) -> Response:
        """The report, or where there is none what to do; status 404."""
        if self._file is None or not self._file.is_file():
            text = f"there is no file {self._file}: 'fsw.py history report' writes it\n"
            return PlainTextResponse(text, status_code=404)
        return FileResponse(self._file, headers={"Content-Security-Policy": _POLICY}, media_type="text/html")
