"""Handles, as user code that was written for genuine rclpy treats them."""

from __future__ import annotations

from types import TracebackType
from typing import Self


class Handle:
    """May be held on to in a ``with`` block, where genuine rclpy puts off destruction; here it is destroyed at once."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        pass
