"""Detection of guessed tokens and passwords."""

from __future__ import annotations

import hashlib

#: different wrong tokens or passwords of a client within the window after which each costs it a
#: connection (chosen)
_MOST_WRONG, _WINDOW_S = 5, 60.0
#: clients that are remembered, the latest
_MOST_CLIENTS = 1000


class WrongLogins:
    """Counts wrong tokens and passwords by client.

    The same wrong credential counts once, so that pages that retry an old one do not lock their
    user out.
    """

    def __init__(self) -> None:
        self._given_s: dict[str, dict[bytes, float]] = {}

    def left_s(self, client: str, now_s: float) -> float:
        """Time for which a client is still locked out [s]; 0: it is not."""
        recent = self._recent(client, now_s)
        return _WINDOW_S - now_s + min(recent.values()) if len(recent) >= _MOST_WRONG else 0.0

    def add(self, client: str, credential: bytes, now_s: float) -> bool:
        """Count a wrong credential of a client that is not locked out; returns whether it is new."""
        recent, digest = self._recent(client, now_s), hashlib.sha256(credential).digest()
        self._given_s.pop(client, None)
        self._given_s[client] = recent | {digest: now_s}
        if len(self._given_s) > _MOST_CLIENTS:
            del self._given_s[next(iter(self._given_s))]
        return digest not in recent

    def _recent(self, client: str, now_s: float) -> dict[bytes, float]:
        given_s = self._given_s.get(client, {})
        return {digest: one_s for digest, one_s in given_s.items() if now_s - one_s < _WINDOW_S}
