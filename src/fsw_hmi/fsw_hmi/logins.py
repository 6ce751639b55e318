"""Checks passwords beside the server's loop, one at a time, the clients in turn: a flood delays nothing but itself."""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from fsw_hmi.users import User

#: checks that wait, of one client and of all (chosen)
_OF_CLIENT, _OF_ALL = 8, 64
_NICE = 10

Check = Callable[[], User | None]
Done = Callable[[User | None], None]
_Check = tuple[Check, Done, Callable[[], None]]


class LoginChecks:
    """A line of checks for each client. Belongs to the server's loop, but for the checks themselves."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, "login", _step_back)
        self._lines: dict[str, deque[_Check]] = {}
        self._running = False

    def submit(self, client: str, check: Check, done: Done, busy: Callable[[], None]) -> None:
        """Have a password checked, then call ``done`` in the loop; ``busy`` if it cannot be checked now."""
        line = self._lines.get(client, deque())
        if len(line) >= _OF_CLIENT or sum(map(len, self._lines.values())) >= _OF_ALL:
            busy()
            return
        line.append((check, done, busy))
        self._lines[client] = line
        self._next()

    def close(self) -> None:
        """Check no more."""
        self._lines.clear()
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _next(self) -> None:
        if self._running or not self._lines:
            return
        client = next(iter(self._lines))
        line = self._lines.pop(client)
        check, done, busy = line.popleft()
        if line:
            self._lines[client] = line  # behind the others
        self._running = True
        asyncio.get_running_loop().run_in_executor(self._pool, check).add_done_callback(
            lambda future: self._on_done(future, done, busy)
        )

    def _on_done(self, future: asyncio.Future[User | None], done: Done, busy: Callable[[], None]) -> None:
        self._running = False
        if future.cancelled() or future.exception():  # at the server's end, or for want of memory
            busy()
        else:
            done(future.result())
        self._next()


def _step_back() -> None:
    """Let whatever controls the weld go first; a thread has a priority of its own on Linux."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), min(19, os.getpriority(os.PRIO_PROCESS, 0) + _NICE))
