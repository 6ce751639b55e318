"""Runs the live page's server in a thread of its own."""

from __future__ import annotations

import asyncio
import ssl
import threading
from collections.abc import Callable

from starlette.types import ASGIApp

from fsw_hmi.web import LivePage
from fsw_hmi.web_server import Listening, server

_PATIENCE_S = 5.0


class WebThread:
    """The server and its loop.

    Parameters
    ----------
    page : LivePage
    app : ASGI application
        With the routes of the page.
    listening : Listening
    encrypted : ssl.SSLContext, optional
    """

    def __init__(
        self, page: LivePage, app: ASGIApp, listening: Listening, encrypted: ssl.SSLContext | None = None
    ) -> None:
        self._page = page
        self._server = server(app, listening.gate, encrypted)
        self._listening = listening
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    def start(self) -> None:
        """Serve from now on."""
        self._thread.start()

    def call(self, function: Callable[[], None]) -> None:
        """Let a function run in the server's loop; may be called in any thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(function)

    @property
    def alive(self) -> bool:
        """Whether the server runs."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Close all pages and end."""
        self.call(self._page.end)
        self._server.should_exit = True
        self._thread.join(_PATIENCE_S)

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        beat = asyncio.create_task(self._page.beat())
        try:
            await self._server.serve(sockets=[self._listening])
        finally:
            beat.cancel()
            self._page.close()
