"""The web server of the page: where it listens, and how much it takes from a client."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterable, Sequence

import uvicorn
from starlette.applications import Starlette
from starlette.middleware.gzip import GZipMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.routing import BaseRoute
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from fsw_hmi.security import Security, client_of, is_loopback

#: hosts by which this computer calls itself
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
#: longest frame that a page may send
MAX_FRAME_BYTES = 4096
#: connections of a client at a time; a page has one, and a few more while it loads
_MAX_CONNECTIONS = 256
#: What the kernel keeps for a client that does not read, so that the server notices soon.
_SEND_BUFFER_BYTES = 65536


def listen(host: str, port: int, patience_s: float = 20.0) -> socket.socket:
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
        one = socket.socket(family, kind, protocol)
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


def address(listening: socket.socket) -> str:
    """What to type into a browser on this computer."""
    host, port = listening.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = "localhost"
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def is_local(listening: socket.socket) -> bool:
    """Whether only this computer can reach it."""
    return is_loopback(listening.getsockname()[0])


def application(routes: Sequence[BaseRoute], hosts: Iterable[str]) -> ASGIApp:
    """The application with these routes, behind the checks of host and origin.

    ``hosts`` are names and addresses under which the page may be asked for, without port, beside those of this
    computer: a foreign page may let its own name point here (DNS rebinding).
    """
    bare = [host.strip("[]") for host in (*LOCAL_HOSTS, *hosts) if host and "*" not in host]
    allowed = [f"[{host}]" if ":" in host else host for host in bare]
    packed = GZipMiddleware(Starlette(routes=list(routes)), minimum_size=0)
    return Security(TrustedHostMiddleware(packed, allowed, www_redirect=False))


class _Connection(H11Protocol):
    """A connection; a client that has too many gets no more, and takes none from others."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        peers = [getattr(one, "client", None) for one in self.connections]
        clients = [client_of(peer[0]) for peer in peers if peer]
        if self.client and clients.count(client_of(self.client[0])) > _MAX_CONNECTIONS:
            transport.abort()


def server(app: ASGIApp) -> uvicorn.Server:
    """Make the server; to be run with ``serve(sockets=[listen(...)])``."""
    return uvicorn.Server(
        uvicorn.Config(
            app,
            http=_Connection,
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
        )
    )
