"""Admission control: limits open connections so that strangers cannot lock operators out."""

from __future__ import annotations

import contextlib
import socket
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from fsw_hmi.security import client_of

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
                key: one for key, one in self._peers.items() if one.connection.fileno() >= 0
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
