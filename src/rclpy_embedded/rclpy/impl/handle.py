"""Handles, as user code that was written for genuine rclpy treats them."""

from __future__ import annotations

from typing import Any, Self

from rclpy.exceptions import InvalidHandle

DESTROYED = "Cannot use Destroyable because destruction was requested"


class Handle:
    """May be held on to in a ``with`` block, where genuine rclpy puts off destruction; here it is destroyed at once."""

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
        """What the middleware knows it by.

        Raises
        ------
        InvalidHandle
            After destruction.
        """
        self._check()
        return self._handle

    def _check(self) -> None:
        if self._handle is None:
            raise InvalidHandle(DESTROYED)

    def destroy(self) -> None:
        """End it; better call the node's method for this."""
        self._handle = None
