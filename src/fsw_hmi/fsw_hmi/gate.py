"""Who gets in: limits of open connections, checks of every request, headers of every answer.

Strangers must not lock operators out, nor other pages make requests, nor a browser run what is
not the page's.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, IPv6Network, ip_address
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

HEADERS = {
    "Content-Security-Policy": "default-src 'self'; connect-src 'self'; style-src 'self'; "
    "img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}
#: counts a request of a client, by its address and port, for as long as it lasts
RequestCounter = Callable[[Any], AbstractContextManager[None]]


class Security:
    """Middleware: refuses requests from other pages, and adds missing security headers.

    The check of the origin refuses cross-site WebSockets. A WebSocket without an origin is
    refused, too; every browser sends one.
    """

    def __init__(self, app: ASGIApp, counted: RequestCounter = lambda _: nullcontext()) -> None:
        self._app, self._counted = app, counted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        app = self._app
        if scope["type"] == "websocket" and not _is_own(scope):
            app = WebSocketClose()
        elif scope["type"] == "http" and not _is_own(scope):
            app = PlainTextResponse("the request comes from another page\n", 403)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        with self._counted(scope.get("client")):
            await app(scope, receive, send_with_headers)


def _is_own(scope: Scope) -> bool:
    """Whether a request comes from the page that this server serves, or from no page."""
    headers = Headers(scope=scope)
    host, origins = headers.get("host", "").lower(), headers.getlist("origin")
    own = {f"http://{host}", f"https://{host}"}
    return own.issuperset(map(str.lower, origins)) and bool(origins or scope["type"] == "http")


def client_of(address: str) -> str:
    """Client by which limits count: an IPv4 address, or the /64 network of an IPv6 address."""
    ip = _ip(address)
    return (
        str(IPv6Network((ip, 64), strict=False))
        if isinstance(ip, IPv6Address)
        else str(ip or address)
    )


def is_loopback(address: str) -> bool:
    """Whether the address belongs to this computer."""
    ip = _ip(address)
    return ip is not None and ip.is_loopback


def _ip(address: str) -> IPv4Address | IPv6Address | None:
    try:
        ip = ip_address(address.partition("%")[0])
    except ValueError:
        return None
    return (ip.ipv4_mapped or ip) if isinstance(ip, IPv6Address) else ip


#: connections of one client, and of all: a page has one, and a few more while it loads (chosen)
_OF_CLIENT, _OF_ALL = 256, 600
#: after which a connection must have sent a whole request, its TLS handshake included (chosen)
_REQUEST_S = 10.0


@dataclass(slots=True, eq=False)
class _Peer:
    connection: socket.socket  #: which the server owns, notices the end of, and closes
    client: str
    since_s: float  #: when it came, or when its last request ended
    requests: int = 0  #: that it has under way; an open page is one
    touched_s: float = 0.0  #: when somebody has last asked for something on its page
    known: bool = False  #: whether a user has logged in there


class Gate:
    """Limits the open connections.

    Beyond the limit of a client, or of all, one connection is closed for each new one: of
    strangers first, then of the client with the most connections, then one that only waits, then
    the page that nobody has touched for longest, then the oldest. A connection that takes longer
    than ``request_s`` for a whole request is closed.
    """

    def __init__(
        self, of_client: int = _OF_CLIENT, of_all: int = _OF_ALL, request_s: float = _REQUEST_S
    ) -> None:
        self._of_client, self._of_all, self._request_s = of_client, of_all, request_s
        self._peers: dict[Any, _Peer] = {}

    def admit(self, address: tuple[str, int], connection: socket.socket, now_s: float) -> None:
        """Let a connection in."""
        client = client_of(address[0])
        if self._rivals(client):  # those that are closed no longer count
            self._peers = {
                key: peer for key, peer in self._peers.items() if peer.connection.fileno() >= 0
            }
        if rivals := self._rivals(client):
            counts = Counter(peer.client for peer in self._peers.values())

            def rank(key: Any) -> tuple[bool, int, bool, float, float]:
                peer = self._peers[key]
                touched_s, since_s = peer.touched_s, peer.since_s
                return peer.known, -counts[peer.client], peer.requests > 0, touched_s, since_s

            self._close(min(rivals, key=rank))
        self._peers[address] = _Peer(connection, client, now_s)

    def _rivals(self, client: str) -> list[Any]:
        """Connections of which one must go for a new one of a client; empty if there is room."""
        own = [key for key, peer in self._peers.items() if peer.client == client]
        if len(own) >= self._of_client:
            return own
        return [*self._peers] if len(self._peers) >= self._of_all else []

    @contextlib.contextmanager
    def request(self, address: Any) -> Iterator[None]:
        """Note that a whole request has arrived, and when it has been answered."""
        peer = self._peers.get(address and tuple(address))
        if peer is None:
            yield
            return
        peer.requests += 1
        try:
            yield
        finally:
            peer.requests -= 1
            peer.since_s = time.monotonic()

    def touch(self, address: Any, known: bool) -> None:
        """Note that somebody has asked for something on a page.

        ``known`` is whether a user has logged in there.
        """
        peer = self._peers.get(address and tuple(address))
        if peer is not None:
            peer.touched_s, peer.known = time.monotonic(), known

    def sweep(self, now_s: float) -> None:
        """Forget connections that are closed, and close those that have waited too long."""
        for address, peer in [*self._peers.items()]:
            late = not peer.requests and now_s - peer.since_s > self._request_s
            if late or peer.connection.fileno() < 0:
                self._close(address)

    def _close(self, address: Any) -> None:
        peer = self._peers.pop(address)
        with contextlib.suppress(OSError):  # it is gone already
            peer.connection.shutdown(socket.SHUT_RDWR)
