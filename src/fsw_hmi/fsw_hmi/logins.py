"""Checks passwords beside the server's loop, one at a time, the clients in turn: a flood delays nothing but itself."""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from fsw_hmi.users import User

#: checks that wait or are under way, of one client and of all (chosen)
_OF_CLIENT, _OF_ALL = 9, 65
_NICE = 10


class BusyError(Exception):
    """A password cannot be checked now."""


class LoginChecks:
    """Each client has one check at most in the line of the one thread. Belongs to the server's loop."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, "login", _step_back)
        self._turns: dict[str, asyncio.Lock] = {}
        self._counts: Counter[str] = Counter()

    async def run(self, client: str, check: Callable[[], User | None]) -> User | None:
        """Have a password checked; raises :class:`BusyError`."""
        if self._counts[client] >= _OF_CLIENT or self._counts.total() >= _OF_ALL:
            raise BusyError
        self._counts[client] += 1
        try:
            async with self._turns.setdefault(client, asyncio.Lock()):
                return await asyncio.get_running_loop().run_in_executor(self._pool, check)
        except (MemoryError, ValueError, RuntimeError) as error:  # for want of memory, or at the server's end
            raise BusyError from error
        finally:
            self._counts[client] -= 1
            if not self._counts[client]:
                del self._counts[client], self._turns[client]

    def close(self) -> None:
        """Check no more."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _step_back() -> None:
    """Let whatever controls the weld go first; a thread has a priority of its own on Linux."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), min(19, os.getpriority(os.PRIO_PROCESS, 0) + _NICE))
