"""A ROS domain that no other process on this machine uses, for short-lived graphs."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

# Domains that fit the port range of Linux, without the low ones that people choose by hand.
_DOMAINS = range(20, 101)
_last = os.getpid()


class NoFreeDomainError(RuntimeError):
    """All domains of this machine are taken."""


@contextmanager
def free_domain() -> Iterator[int]:
    """Reserve a ROS domain (20 to 100) on this machine while the context lasts.

    The reservation is the name of a local socket: the kernel ends it with its process, and no file
    is left. Each call of a process takes another domain, because killed
    participants linger in theirs until their lease ends.

    Raises
    ------
    NoFreeDomainError
        If all domains are taken.
    """
    global _last
    for _ in _DOMAINS:
        _last += 1
        domain = _DOMAINS[_last % len(_DOMAINS)]
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as reservation:
            try:
                reservation.bind(f"\0ros_domain_{domain}")
            except OSError:  # it is in use
                continue
            yield domain
            return
    ends = f"{_DOMAINS.start} to {_DOMAINS.stop - 1}"
    raise NoFreeDomainError(f"no free ROS domain of {ends}; stop other runs first")
