"""The report on all previous welds, in a tab of the page."""

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


def routes(file: str) -> list[Route]:
    """Route ``/all_welds`` with the report, read for every request; none without a file."""

    async def answer(_: Request) -> Response:
        return response(file)

    return [Route("/all_welds", answer)] if file else []


def response(file: str) -> Response:
    """The report, or status 404 with a remedy."""
    path = Path(file).expanduser()
    if not path.is_file():
        return PlainTextResponse(
            f"there is no file {path}: 'fsw.py history report' writes it\n", status_code=404
        )
    return FileResponse(path, headers={"Content-Security-Policy": _POLICY}, media_type="text/html")
