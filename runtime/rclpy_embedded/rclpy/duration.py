"""Signed spans of time with nanosecond resolution."""

from functools import total_ordering
from typing import Self

from builtin_interfaces import msg as builtin_msg
from rclpy.constants import INT64_MAX, INT64_MIN, S_TO_NS


@total_ordering
class NanosecondValue:
    """A number of nanoseconds with an order and, like the genuine classes, without a hash."""

    __slots__ = ("__weakref__", "_nanoseconds")
    __hash__ = None  # type: ignore[assignment]
    _nanoseconds: int

    @property
    def nanoseconds(self) -> int:
        return self._nanoseconds

    def _check_comparable(self, other: Self) -> None: ...

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return NotImplemented
        self._check_comparable(other)
        return self._nanoseconds == other._nanoseconds

    def __lt__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return NotImplemented
        self._check_comparable(other)
        return self._nanoseconds < other._nanoseconds


class Duration(NanosecondValue):
    """A signed period between two time points; `seconds` and `nanoseconds` are added."""

    __slots__ = ()

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not INT64_MIN <= total <= INT64_MAX:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._nanoseconds = total

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self._nanoseconds})"

    def __str__(self) -> str:
        return "Infinite" if self._nanoseconds == INT64_MAX else f"{self._nanoseconds} nanoseconds"

    def to_msg(self) -> builtin_msg.Duration:
        sec, nanosec = divmod(self._nanoseconds, S_TO_NS)
        return builtin_msg.Duration(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: builtin_msg.Duration) -> Self:
        if not isinstance(msg, builtin_msg.Duration):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


#: A span that never ends.
Infinite = Duration(nanoseconds=INT64_MAX)
