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

#: connections of all clients: a page has one, and a few more while it loads (chosen)
_MOST = 600
#: after which a connection must have sent a whole request, its TLS handshake included (chosen)
_REQUEST_S = 10.0


@dataclass(slots=True, eq=False)
class Peer:
    """An open connection."""

    connection: socket.socket  #: which the server owns, notices the end of, and closes
    client: str
    since_s: float  #: when it came, when its last request ended, or when it was touched
    requests: int = 0  #: that it has under way; an open page is one
    known: bool = False  #: whether somebody there may stop the weld, and has asked for something

    def touch(self, known: bool) -> None:
        """Note that somebody has asked for something on its page."""
        self.since_s, self.known = time.monotonic(), known


class Gate:
    """Limits the open connections.

    Beyond ``most`` connections each new one closes another: of strangers first, then of the client
    with the most connections, then one that only waits, then the one that nobody has touched for
    longest. A connection that takes longer than ``request_s`` for a whole request is closed.
    """

    def __init__(self, most: int = _MOST, request_s: float = _REQUEST_S) -> None:
        self._most, self._request_s = most, request_s
        self._peers: dict[Any, Peer] = {}  # by address and port

    def admit(self, address: tuple[str, int], connection: socket.socket, now_s: float) -> None:
        """Let a connection in."""
        if len(self._peers) >= self._most:
            self.sweep(now_s)  # those that are closed do not count
        if len(self._peers) >= self._most:
            counts = Counter(peer.client for peer in self._peers.values())

            def rank(key: Any) -> tuple[bool, int, bool, float]:
                peer = self._peers[key]
                return peer.known, -counts[peer.client], peer.requests > 0, peer.since_s

            self._close(min(self._peers, key=rank))
        self._peers[address] = Peer(connection, client_of(address[0]), now_s)

    @contextlib.contextmanager
    def request(self, address: Any) -> Iterator[Peer | None]:
        """Note that a whole request has arrived, and when it has been answered."""
        peer = self._peers.get(address and tuple(address))
        if peer is None:
            yield None
            return
        peer.requests += 1
        try:
            yield peer
        finally:
            peer.requests -= 1
            peer.since_s = time.monotonic()

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
