"""Signed spans of time with nanosecond resolution."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.constants import INT64_MAX, INT64_MIN, S_TO_NS

if TYPE_CHECKING:
    import builtin_interfaces.msg


class Duration:
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

    __slots__ = ("__weakref__", "_nanoseconds")

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not INT64_MIN <= total <= INT64_MAX:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._nanoseconds = total

    @property
    def nanoseconds(self) -> int:
        """Total length in nanoseconds."""
        return self._nanoseconds

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self._nanoseconds})"

    def __str__(self) -> str:
        return "Infinite" if self._nanoseconds == INT64_MAX else f"{self._nanoseconds} nanoseconds"

    # Like the genuine class: equality without a hash.
    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return self._nanoseconds == other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def __ne__(self, other: object) -> bool:
        return self._nanoseconds != other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def __lt__(self, other: object) -> bool:
        return self._nanoseconds < other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def __le__(self, other: object) -> bool:
        return self._nanoseconds <= other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def __gt__(self, other: object) -> bool:
        return self._nanoseconds > other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def __ge__(self, other: object) -> bool:
        return self._nanoseconds >= other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def to_msg(self) -> builtin_interfaces.msg.Duration:
        """Return the duration as ``builtin_interfaces/msg/Duration``."""
        from builtin_interfaces.msg import Duration as DurationMsg

        sec, nanosec = divmod(self._nanoseconds, S_TO_NS)
        return DurationMsg(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: builtin_interfaces.msg.Duration) -> Duration:
        """Create a duration from a ``builtin_interfaces/msg/Duration``; anything else is a TypeError."""
        from builtin_interfaces.msg import Duration as DurationMsg

        if not isinstance(msg, DurationMsg):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


#: A span that never ends.
Infinite = Duration(nanoseconds=INT64_MAX)
