"""Services whose response is a few values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node


def serve(
    node: Node, kind: Any, name: str, answer: Callable[[Any], dict[str, Any] | None]
) -> None:
    """Offer a service; ``answer`` maps the request to the response's fields (None: empty)."""

    def respond(request: Any, response: Any) -> Any:
        for field, value in (answer(request) or {}).items():
            setattr(response, field, value)
        return response

    node.create_service(kind, name, respond)
