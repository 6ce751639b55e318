"""The token that a person must know to command where there are no named users; who tries tokens and passwords."""

from __future__ import annotations

import hashlib
import secrets
from pathlib import Path

from fsw_control.private_file import read_private

#: 12 random digits last 15 years at 1000 trials a second
_SHORTEST = 12
_LONGEST_BYTES = 4096
#: different wrong tokens or passwords of a client within the window after which each costs it a connection (chosen)
_MOST_WRONG, _WINDOW_S = 5, 60.0
#: clients that are remembered, the latest
_MOST_CLIENTS = 1000


class WrongLogins:
    """Tells which clients try tokens or passwords, each for itself.

    The same wrong one counts once, so that pages that log in again with an old one do not lock their user out.
    """

    def __init__(self) -> None:
        self._given_s: dict[str, dict[bytes, float]] = {}

    def left_s(self, client: str, now_s: float) -> float:
        """For how long a client is shut out [s], 0 when it is not."""
        recent = self._recent(client, now_s)
        return _WINDOW_S - now_s + min(recent.values()) if len(recent) >= _MOST_WRONG else 0.0

    def knows(self, client: str, token: bytes, now_s: float) -> bool:
        """Whether a client has given this wrong one lately."""
        return hashlib.sha256(token).digest() in self._recent(client, now_s)

    def add(self, client: str, token: bytes, now_s: float) -> float:
        """Take note of a wrong one; returns for how long the client is shut out already [s], 0 when it is not."""
        left_s = self.left_s(client, now_s)
        if left_s:
            return left_s
        recent = self._recent(client, now_s) | {hashlib.sha256(token).digest(): now_s}
        self._given_s.pop(client, None)
        self._given_s[client] = recent
        if len(self._given_s) > _MOST_CLIENTS:
            del self._given_s[next(iter(self._given_s))]
        return 0.0

    def _recent(self, client: str, now_s: float) -> dict[bytes, float]:
        given_s = self._given_s.get(client, {})
        return {digest: one_s for digest, one_s in given_s.items() if now_s - one_s < _WINDOW_S}


def new() -> str:
    """A token for one run."""
    return secrets.token_urlsafe(12)


def read(path: Path) -> str:
    """The token in a file.

    Raises
    ------
    ValueError
        When the file cannot be read or is empty, or others may read or change the file; the message says what to do.
    """
    try:
        token = read_private("token_file", path, _LONGEST_BYTES).decode().strip()
    except UnicodeDecodeError:
        raise ValueError(f"token_file: {path} is no text") from None
    if len(token) < _SHORTEST or "\n" in token:
        raise ValueError(f"token_file: {path} must hold one line of at least {_SHORTEST} characters")
    return token
