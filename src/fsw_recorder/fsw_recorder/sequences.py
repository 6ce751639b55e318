"""Which messages are missing, by the numbers that publishers give to theirs."""

from __future__ import annotations

from collections.abc import Callable


class Sequences:
    """The sequences of numbers, one of each publisher, that arrive mixed on one topic.

    The middleware tells a message's number, but not whose it is. One that continues no sequence
    begins another, if a publisher has not been heard yet or all sequences are beyond it (a
    publisher that was started again); otherwise numbers are missing in the closest sequence before
    it.
    """

    def __init__(self) -> None:
        self._ends: list[int] = []

    def take(self, number: int, publishers: Callable[[], int]) -> int:
        """Take a message's number; returns how many are missing before it.

        ``publishers`` returns how many there are at present; it is only asked where no sequence is
        continued.
        """
        before = max((end for end in self._ends if end < number), default=None)
        if before is None or (before != number - 1 and len(self._ends) < publishers()):
            self._ends.append(number)
            return 0
        self._ends[self._ends.index(before)] = number
        return number - before - 1
