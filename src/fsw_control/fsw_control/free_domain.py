"""A ROS domain that no other process on this machine uses, for short-lived graphs."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

# Domains that fit the port range of Linux, without the low ones that people choose by hand.
_DOMAINS = range(20, 101)
_last = os.getpid()


class NoFreeDomainError(RuntimeError):
    """All domains of this machine are taken."""


@contextlib.contextmanager
def free_domain() -> Iterator[int]:
    """Reserve a ROS domain (20 to 100) on this machine, by a lock file, while the context lasts.

    Each call of a process takes another domain: killed participants linger in theirs until their
    lease ends.

    Raises
    ------
    NoFreeDomainError
        If all domains are taken.
    """
    global _last
    for _ in _DOMAINS:
        _last += 1
        domain = _DOMAINS[_last % len(_DOMAINS)]
        with contextlib.ExitStack() as stack:
            try:
                file = stack.enter_context(
                    (Path(tempfile.gettempdir()) / f"ros_domain_{domain}.lock").open("w")
                )
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:  # in use, or another user's file
                continue
            yield domain
            return
    raise NoFreeDomainError(
        f"no free ROS domain of {_DOMAINS.start} to {_DOMAINS.stop - 1}; stop other runs first"
    )
