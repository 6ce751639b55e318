"""Handles, as programs that were written for genuine rclpy use them, and what is only held weakly."""

from collections.abc import Iterator
from typing import Any, Generic, Self, TypeVar
from weakref import WeakKeyDictionary

from rclpy.exceptions import InvalidHandle

DESTROYED = "cannot use Destroyable because destruction was requested"
_Member = TypeVar("_Member")


class Handle:
    """Can be used in a ``with`` block. Genuine rclpy delays destruction until its end; here it is immediate."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        pass


class Destroyable(Handle):
    """Has a handle, perhaps itself, until it is destroyed, which any thread may do at any time."""

    _handle: Any = None

    def __init__(self, handle: Any = None) -> None:
        self._handle = self if handle is None else handle

    @property
    def handle(self) -> Any:
        """The entity in the middleware; InvalidHandle after destruction."""
        handle = self._handle
        if handle is None:
            raise InvalidHandle(DESTROYED)
        return handle

    def _check(self) -> None:
        _ = self.handle

    def destroy(self) -> None:
        """End it; programs call the node's method for this."""
        if vars(self).pop("_handle", None) is not None:  # in one step, so that one of several threads does it
            self._clean_up()

    def _clean_up(self) -> None: ...


class WeakMembers(Generic[_Member]):
    """Objects that are still in use. Unlike a WeakSet it may change while another thread iterates over it."""

    def __init__(self) -> None:
        self._members: WeakKeyDictionary[_Member, None] = WeakKeyDictionary()

    def add(self, member: _Member) -> None:
        self._members[member] = None

    def discard(self, member: _Member) -> None:
        self._members.pop(member, None)

    def __iter__(self) -> Iterator[_Member]:
        return iter([member for reference in self._members.keyrefs() if (member := reference()) is not None])

    def __bool__(self) -> bool:
        return any(True for _ in self)
