"""Recognises a message that was received twice."""

from __future__ import annotations

from collections import deque


class Repeats:
    """The latest messages of a topic by the time of their publication and their content.

    Parameters
    ----------
    kept : int
        How many are remembered.
    """

    def __init__(self, kept: int = 4096) -> None:
        self._order: deque[tuple[int, int]] = deque()
        self._known: set[tuple[int, int]] = set()
        self._kept = kept

    def seen(self, published_ns: int, data: bytes) -> bool:
        """Whether this message came before; it is remembered from now on."""
        key = (published_ns, hash(data))
        if key in self._known:
            return True
        self._known.add(key)
        self._order.append(key)
        if len(self._order) > self._kept:
            self._known.discard(self._order.popleft())
        return False
