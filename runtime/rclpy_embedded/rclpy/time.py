"""Points in time."""

from __future__ import annotations

from typing import overload

from builtin_interfaces import msg as builtin_msg
from rclpy.clock_type import ClockType
from rclpy.constants import INT64_MAX, S_TO_NS
from rclpy.duration import Duration, NanosecondValue


class Time(NanosecondValue):
    """A point in time: nanoseconds since the epoch of a kind of clock. Those of different kinds cannot be compared."""

    __slots__ = ("_clock_type",)

    def __init__(
        self, *, seconds: float = 0, nanoseconds: int = 0, clock_type: ClockType = ClockType.SYSTEM_TIME
    ) -> None:
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        if seconds < 0:
            raise ValueError("Seconds value must not be negative")
        if nanoseconds < 0:
            raise ValueError("Nanoseconds value must not be negative")
        self._nanoseconds = int(seconds * S_TO_NS) + int(nanoseconds)
        if self._nanoseconds > INT64_MAX:
            raise OverflowError("Total nanoseconds value is too large to store in C time point.")
        self._clock_type = clock_type

    @property
    def clock_type(self) -> ClockType:
        return self._clock_type

    def seconds_nanoseconds(self) -> tuple[int, int]:
        return divmod(self._nanoseconds, S_TO_NS)

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self._nanoseconds}, clock_type={self._clock_type.name})"

    def __add__(self, other: Duration) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        try:
            return Time(nanoseconds=self._nanoseconds + other.nanoseconds, clock_type=self._clock_type)
        except OverflowError as error:
            raise OverflowError("Addition leads to overflow in C storage.") from error

    __radd__ = __add__

    @overload
    def __sub__(self, other: Time) -> Duration: ...
    @overload
    def __sub__(self, other: Duration) -> Time: ...
    def __sub__(self, other: Time | Duration) -> Time | Duration:
        if isinstance(other, Time):
            self._check_comparable(other, "subtract")
            return Duration(nanoseconds=self._nanoseconds - other._nanoseconds)
        if not isinstance(other, Duration):
            return NotImplemented
        try:
            return Time(nanoseconds=self._nanoseconds - other.nanoseconds, clock_type=self._clock_type)
        except ValueError as error:
            raise ValueError("Subtraction leads to negative time.") from error

    def _check_comparable(self, other: Time, operation: str = "compare") -> None:
        if self._clock_type != other._clock_type:
            raise TypeError(f"Can't {operation} times with different clock types")

    def to_msg(self) -> builtin_msg.Time:
        sec, nanosec = self.seconds_nanoseconds()
        return builtin_msg.Time(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: builtin_msg.Time, clock_type: ClockType = ClockType.ROS_TIME) -> Time:
        if not isinstance(msg, builtin_msg.Time):
            raise TypeError("Must pass a builtin_interfaces.msg.Time object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)
