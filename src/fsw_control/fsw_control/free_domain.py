"""A ROS domain that no other process on this machine uses, for short-lived graphs."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

# Domains that the ports of Linux allow, without the low ones that people use by hand.
_DOMAINS = range(20, 101)
_last = os.getpid()


class NoFreeDomainError(RuntimeError):
    """All domains of this machine are taken."""


@contextlib.contextmanager
def free_domain() -> Iterator[int]:
    """A ROS domain (20 to 100) that lock files reserve on this machine for as long as the context lasts.

    A process takes another one every time: participants that were killed linger in their domain
    until their lease ends.

    Raises
    ------
    NoFreeDomainError
        When all are taken.
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
