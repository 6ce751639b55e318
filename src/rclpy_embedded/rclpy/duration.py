"""Signed spans of time with nanosecond resolution."""

from __future__ import annotations

import builtin_interfaces.msg
from rclpy.constants import INT64_MAX, INT64_MIN, S_TO_NS


class NanosecondValue:
    """Order of values that are a number of nanoseconds; like the genuine classes they have no hash."""

    __slots__ = ("__weakref__", "_nanoseconds")
    __hash__ = None  # type: ignore[assignment]

    _nanoseconds: int

    @property
    def nanoseconds(self) -> int:
        """The value in nanoseconds."""
        return self._nanoseconds

    def _comparable(self, other: object) -> int | None:
        """Return the nanoseconds of `other` if it can be compared with this, else None."""
        raise TypeError(f"{type(self).__name__} has no order")

    def __eq__(self, other: object) -> bool:
        return NotImplemented if (ns := self._comparable(other)) is None else self._nanoseconds == ns

    def __ne__(self, other: object) -> bool:
        return NotImplemented if (ns := self._comparable(other)) is None else self._nanoseconds != ns

    def __lt__(self, other: object) -> bool:
        return NotImplemented if (ns := self._comparable(other)) is None else self._nanoseconds < ns

    def __le__(self, other: object) -> bool:
        return NotImplemented if (ns := self._comparable(other)) is None else self._nanoseconds <= ns

    def __gt__(self, other: object) -> bool:
        return NotImplemented if (ns := self._comparable(other)) is None else self._nanoseconds > ns

    def __ge__(self, other: object) -> bool:
        return NotImplemented if (ns := self._comparable(other)) is None else self._nanoseconds >= ns


class Duration(NanosecondValue):
    """A signed period between two time points.

    Parameters
    ----------
    seconds : float
        Seconds; the fractional part counts.
    nanoseconds : int
        Added to `seconds`; a fractional part is dropped.

    Raises
    ------
    OverflowError
        If the total does not fit into 64 bits.
    """

    __slots__ = ()

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not INT64_MIN <= total <= INT64_MAX:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._nanoseconds = total

    def _comparable(self, other: object) -> int | None:
        return other._nanoseconds if isinstance(other, Duration) else None

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self._nanoseconds})"

    def __str__(self) -> str:
        return "Infinite" if self._nanoseconds == INT64_MAX else f"{self._nanoseconds} nanoseconds"

    def to_msg(self) -> builtin_interfaces.msg.Duration:
        """Return the duration as ``builtin_interfaces/msg/Duration``."""
        sec, nanosec = divmod(self._nanoseconds, S_TO_NS)
        return builtin_interfaces.msg.Duration(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: builtin_interfaces.msg.Duration) -> Duration:
        """Create a duration from a ``builtin_interfaces/msg/Duration``; anything else is a TypeError."""
        if not isinstance(msg, builtin_interfaces.msg.Duration):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


#: A span that never ends.
Infinite = Duration(nanoseconds=INT64_MAX)
