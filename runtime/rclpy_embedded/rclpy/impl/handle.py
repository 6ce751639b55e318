"""Handles, as programs that were written for genuine rclpy use them."""

from typing import Any, Self

from rclpy.exceptions import InvalidHandle

DESTROYED = "cannot use Destroyable because destruction was requested"


class Handle:
    """May be held in a ``with`` block. Genuine rclpy puts off destruction until its end; here there is no delay."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        pass


class Destroyable:
    """Has a handle until it is destroyed."""

    def __init__(self, handle: Any = None) -> None:
        self._handle: Any = Handle() if handle is None else handle

    @property
    def handle(self) -> Any:
        """The entity in the middleware; InvalidHandle after destruction."""
        self._check()
        return self._handle

    def _check(self) -> None:
        if self._handle is None:
            raise InvalidHandle(DESTROYED)

    def destroy(self) -> None:
        """End it; programs call the node's method for this."""
        self._handle = None
