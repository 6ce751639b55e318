"""Web server of the page: listening socket, TLS and limits per client."""

from __future__ import annotations

import asyncio
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.middleware.gzip import GZipMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.routing import BaseRoute
from starlette.types import ASGIApp

from fsw_control.schema.files import read_private
from fsw_hmi.gate import Gate, Security, is_loopback
from fsw_hmi.web import LivePage

#: names of this computer for itself
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
#: longest frame that a page may send
MAX_FRAME_BYTES = 4096
#: What the kernel keeps for a client that does not read, so that the server notices soon.
_SEND_BUFFER_BYTES = 65536
#: connections that wait in the kernel, all of which the loop accepts at once: a flood of new ones
#: must not delay a safe stop (measured: 1.0 s with uvicorn's 2048, 0.11 s with this)
_BACKLOG = 32
#: after which a page that takes nothing is given up (chosen), and for the end of the server's
#: thread
_PATIENCE_S, _END_S = 10.0, 5.0


class Listening(socket.socket):
    """Listening socket with admission control before TLS and HTTP."""

    gate: Gate

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a connection; the gate may close it, or another one in its place."""
        connection, peer = super().accept()
        self.gate.admit(peer[:2], connection, time.monotonic())
        return connection, peer


def listen(host: str, port: int, patience_s: float = _PATIENCE_S) -> Listening:
    """Open the listening socket; port 0: any free port.

    The kernel drops a connection whose client has taken nothing for ``patience_s``.

    Raises
    ------
    ValueError
        When that is not possible; the message says what to do.
    """
    listening: Listening | None = None
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listening = Listening(family, kind, protocol)
        listening.gate = Gate()
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            listening.setsockopt(
                socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * patience_s)
            )
        listening.bind(address)
        listening.listen(_BACKLOG)
    except OSError as error:
        if listening is not None:
            listening.close()
        raise ValueError(
            f"cannot listen on {host!r} port {port}: {error.strerror}; "
            "give an address of this computer, and a free port (0: any)"
        ) from None
    return listening


def tls_context(certificate: str, key: str) -> ssl.SSLContext | None:
    """TLS context of the server; None without files.

    Raises
    ------
    ValueError
        When others may read the key, or OpenSSL cannot use the two; the message has the reason.
    """
    if not certificate and not key:
        return None
    if not certificate or not key:
        raise ValueError("tls_cert, tls_key: give both or neither")
    files = Path(certificate).expanduser(), Path(key).expanduser()
    read_private("tls_key", files[1])
    made = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    made.minimum_version = ssl.TLSVersion.TLSv1_2  # the default of some builds is older
    try:
        made.load_cert_chain(*files, password=lambda: "")
    except OSError as error:
        why = getattr(error, "reason", None) or error.strerror
        raise ValueError(f"tls_cert: {files[0]} with tls_key {files[1]}: {why}") from None
    return made


def address(listening: socket.socket, encrypted: bool = False) -> str:
    """Address of the page for a browser on this computer."""
    host, port = listening.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = "localhost"
    return f"http{'s' * encrypted}://{f'[{host}]' if ':' in host else host}:{port}/"


def is_local(listening: socket.socket) -> bool:
    """Whether only this computer can reach the page."""
    return is_loopback(listening.getsockname()[0])


def application(routes: Sequence[BaseRoute], hosts: Iterable[str], gate: Gate) -> ASGIApp:
    """The application with these routes, behind the checks of host and origin.

    ``hosts`` are names and addresses under which the page may be asked for, without port, beside
    those of this computer: a foreign page may let its own name point here (DNS rebinding).
    """
    bare = [host.strip("[]") for host in (*LOCAL_HOSTS, *hosts) if host and "*" not in host]
    allowed = [f"[{host}]" if ":" in host else host for host in bare]
    packed = GZipMiddleware(Starlette(routes=list(routes)), minimum_size=0)
    return Security(TrustedHostMiddleware(packed, allowed, www_redirect=False), gate.request)


class _Server(uvicorn.Server):
    """Closes connections without a complete request in time, which uvicorn would keep open."""

    def __init__(self, config: uvicorn.Config, gate: Gate, beat: Callable[[], object]) -> None:
        super().__init__(config)
        self._gate, self._beat = gate, beat

    async def on_tick(self, counter: int) -> bool:
        """Called ten times a second by uvicorn."""
        self._gate.sweep(time.monotonic())
        if counter % 2 == 0:
            self._beat()
        return await super().on_tick(counter)


def server(
    app: ASGIApp,
    gate: Gate,
    encrypted: ssl.SSLContext | None = None,
    beat: Callable[[], object] = lambda: None,
) -> uvicorn.Server:
    """Server to be run with ``serve(sockets=[listen(...)])``; calls ``beat`` every 0.2 s."""
    config = uvicorn.Config(
        app,
        http="h11",
        backlog=_BACKLOG,
        ws="websockets-sansio",
        ws_max_size=MAX_FRAME_BYTES,
        ws_per_message_deflate=False,
        loop="asyncio",
        lifespan="off",
        interface="asgi3",
        timeout_graceful_shutdown=1,
        access_log=False,
        log_config=None,
        log_level="error",
        proxy_headers=False,
        server_header=False,
        ssl_context_factory=None if encrypted is None else lambda _config, _default: encrypted,
    )
    return _Server(config, gate, beat)


class WebThread:
    """The live page's server in a thread of its own; ``app`` has the routes of the page."""

    def __init__(
        self,
        page: LivePage,
        app: ASGIApp,
        listening: Listening,
        encrypted: ssl.SSLContext | None = None,
    ) -> None:
        self._page, self._listening = page, listening
        self._server = server(app, listening.gate, encrypted, page.beat)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    def start(self) -> None:
        """Start to serve."""
        self._thread.start()

    def call(self, function: Callable[[], None]) -> None:
        """Run a function in the server's loop; may be called from any thread."""
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
        self._thread.join(_END_S)

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            try:
                runner.run(self._server.serve(sockets=[self._listening]))
            finally:
                self._page.close()
