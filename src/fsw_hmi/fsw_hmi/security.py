"""Checks of every request, and headers that restrict what a browser may do with the answer."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
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
Counter = Callable[[Any], AbstractContextManager[None]]


class Security:
    """Middleware: refuses requests from other pages, and adds missing security headers.

    The check of the origin refuses cross-site WebSockets. A WebSocket without an origin is
    refused, too; every browser sends one.
    """

    def __init__(self, app: ASGIApp, counted: Counter = lambda _: nullcontext()) -> None:
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
