"""Login attempts: detection of guessing, and password checks outside the server's loop."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from fsw_hmi.users import User

#: checks that wait or are under way, of one client and of all (chosen)
_OF_CLIENT, _OF_ALL = 9, 65
_NICE = 10
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

    def knows(self, client: str, token: bytes, now_s: float) -> bool:
        """Whether a client has recently tried this wrong credential."""
        return hashlib.sha256(token).digest() in self._recent(client, now_s)

    def add(self, client: str, token: bytes, now_s: float) -> float:
        """Count a wrong credential; returns the remaining lock-out of the client [s]."""
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


class BusyError(Exception):
    """Too many password checks are pending."""


class LoginChecks:
    """Checks passwords one at a time, clients in turn: a flood delays only its own client.

    Each client has at most one check in the queue of the single thread. Belongs to the server's loop.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, "login", _step_back)
        self._turns: dict[str, asyncio.Lock] = {}
        self._counts: Counter[str] = Counter()

    async def run(self, client: str, check: Callable[[], User | None]) -> User | None:
        """Check a password; raises :class:`BusyError`."""
        if self._counts[client] >= _OF_CLIENT or self._counts.total() >= _OF_ALL:
            raise BusyError
        self._counts[client] += 1
        try:
            async with self._turns.setdefault(client, asyncio.Lock()):
                return await asyncio.get_running_loop().run_in_executor(self._pool, check)
        # for want of memory, or at the server's end
        except (MemoryError, ValueError, RuntimeError) as error:
            raise BusyError from error
        finally:
            self._counts[client] -= 1
            if not self._counts[client]:
                del self._counts[client], self._turns[client]

    def close(self) -> None:
        """Stop checking."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _step_back() -> None:
    """Lower this thread's priority, so that control goes first; Linux has priorities by thread."""
    with contextlib.suppress(OSError):
        nice = min(19, os.getpriority(os.PRIO_PROCESS, 0) + _NICE)
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), nice)
