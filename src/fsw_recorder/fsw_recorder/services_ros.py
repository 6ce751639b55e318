"""Services whose answer is a few values."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node


def serve(node: Node, kind: Any, name: str, answer: Callable[[Any], dict[str, Any] | None]) -> None:
    """Offer a service; ``answer`` takes the request and returns the response's fields (None: an empty response)."""

    node.create_service(kind, name, lambda request, response: _filled(response, answer(request)))


def serve_later(node: Node, kind: Any, name: str, answer: Callable[[], Awaitable[dict[str, Any] | None]]) -> None:
    """Offer a service whose answer takes time; the node's other callbacks go on meanwhile."""

    async def respond(_: Any, response: Any) -> Any:
        return _filled(response, await answer())

    # a group of its own: a callback that awaits keeps its group busy
    node.create_service(kind, name, respond, callback_group=ReentrantCallbackGroup())


def _filled(response: Any, values: dict[str, Any] | None) -> Any:
    for field, value in (values or {}).items():
        setattr(response, field, value)
    return response
