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
    known: bool = False

    @property
    def rank(self) -> tuple[bool, float, float]:
        """Eviction order: idle connections, then pages never touched, then the others.

        The oldest goes first, of touched pages the one whose last touch is longest ago.
        """
        return self.requests > 0, self.touched_s, self.since_s


class Gate:
    """Limits the open connections.

    Beyond the limit, the client with the most connections loses the oldest one that only waits,
    then the page of a stranger that nobody has touched for longest. Pages of users who are logged
    in stay; if there are no others, the new connection is closed. A connection that takes longer
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
        self._peers[address] = _Peer(connection, client, now_s)
        counts = Counter(peer.client for peer in self._peers.values())
        if counts[client] > self._of_client:
            self._make_room(client, address)
        elif len(self._peers) > self._of_all:
            self._make_room(counts.most_common(1)[0][0], address)

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

    def _make_room(self, client: str, newest: Any) -> None:
        peers = {key: one for key, one in self._peers.items() if one.connection.fileno() >= 0}
        self._peers = peers
        others = [key for key, one in peers.items() if one.client == client and not one.known]
        others = [key for key in others if key != newest]
        self._close(min(others, key=lambda key: peers[key].rank, default=newest))

    def _close(self, address: Any) -> None:
        peer = self._peers.pop(address)
        with contextlib.suppress(OSError):  # it is gone already
            peer.connection.shutdown(socket.SHUT_RDWR)
