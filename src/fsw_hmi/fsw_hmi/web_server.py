"""The web server of the page: where it listens, and how much it takes from a client."""

from __future__ import annotations

import socket
import ssl
import time
from collections.abc import Iterable, Sequence
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.middleware.gzip import GZipMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.routing import BaseRoute
from starlette.types import ASGIApp

from fsw_hmi.gate import Gate
from fsw_hmi.security import Security, is_loopback

#: hosts by which this computer calls itself
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
#: longest frame that a page may send
MAX_FRAME_BYTES = 4096
#: What the kernel keeps for a client that does not read, so that the server notices soon.
_SEND_BUFFER_BYTES = 65536


class Listening(socket.socket):
    """The socket to listen on, with the gate through which every connection comes, before TLS and HTTP."""

    gate: Gate

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a connection; the gate may close it, or another one in its place."""
        one, peer = super().accept()
        self.gate.admit(peer[:2], one, time.monotonic())
        return one, peer


def listen(host: str, port: int, patience_s: float = 20.0) -> Listening:
    """Open the socket to listen on; port 0 is any free one.

    The kernel drops a connection whose client has taken nothing for ``patience_s``.

    Raises
    ------
    ValueError
        When that is not possible; the message says what to do.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        one = Listening(family, kind, protocol)
        one.gate = Gate()
    except OSError as error:
        raise ValueError(f"cannot listen on {host!r}: {error.strerror}; give an address of this computer") from None
    try:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * patience_s))
        one.bind(address)
        one.listen(128)
    except OSError as error:
        one.close()
        raise ValueError(
            f"cannot listen on {host} port {port}: {error.strerror}; choose another port (0: any free one)"
        ) from None
    return one


def address(listening: socket.socket, encrypted: bool = False) -> str:
    """What to type into a browser on this computer."""
    host, port = listening.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = "localhost"
    return f"http{'s' * encrypted}://{f'[{host}]' if ':' in host else host}:{port}/"


def is_local(listening: socket.socket) -> bool:
    """Whether only this computer can reach it."""
    return is_loopback(listening.getsockname()[0])


def application(routes: Sequence[BaseRoute], hosts: Iterable[str], gate: Gate) -> ASGIApp:
    """The application with these routes, behind the checks of host and origin.

    ``hosts`` are names and addresses under which the page may be asked for, without port, beside those of this
    computer: a foreign page may let its own name point here (DNS rebinding).
    """
    bare = [host.strip("[]") for host in (*LOCAL_HOSTS, *hosts) if host and "*" not in host]
    allowed = [f"[{host}]" if ":" in host else host for host in bare]
    packed = GZipMiddleware(Starlette(routes=list(routes)), minimum_size=0)
    return Security(TrustedHostMiddleware(packed, allowed, www_redirect=False), gate.request)


class _Server(uvicorn.Server):
    """Closes, ten times a second, connections that have sent no whole request in time; uvicorn waits for ever."""

    def __init__(self, config: uvicorn.Config, gate: Gate) -> None:
        super().__init__(config)
        self._gate = gate

    async def on_tick(self, counter: int) -> bool:
        self._gate.sweep(time.monotonic())
        return await super().on_tick(counter)


def server(app: ASGIApp, gate: Gate, encrypted: ssl.SSLContext | None = None) -> uvicorn.Server:
    """Make the server; to be run with ``serve(sockets=[listen(...)])``."""
    config = uvicorn.Config(
        app,
        http="h11",
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
    return _Server(config, gate)
