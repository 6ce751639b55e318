"""Detects missing messages by the publishers' sequence numbers."""

from __future__ import annotations

from collections.abc import Callable


class Sequences:
    """The mixed sequences of numbers of several publishers on one topic.

    The middleware reports a message's number, but not its publisher. A number that continues no
    sequence begins another one if there is a new publisher, or if all sequences are beyond it (a
    restarted publisher); otherwise numbers are missing in the closest sequence before it.
    """

    def __init__(self) -> None:
        self._ends: list[int] = []

    def take(self, number: int, publishers: Callable[[], int]) -> int:
        """Take a message's number; return how many are missing before it.

        ``publishers`` returns their present number; it is only called if no sequence is continued.
        """
        before = max((end for end in self._ends if end < number), default=None)
        if before is None or (before != number - 1 and len(self._ends) < publishers()):
            self._ends.append(number)
            return 0
        self._ends[self._ends.index(before)] = number
        return number - before - 1
