"""What takes part in the transitions of a managed node."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import wraps
from typing import Any

from lifecycle_msgs.msg import Transition


class TransitionCallbackReturn(IntEnum):
    """What a transition callback returns."""

    SUCCESS = Transition.TRANSITION_CALLBACK_SUCCESS
    FAILURE = Transition.TRANSITION_CALLBACK_FAILURE
    ERROR = Transition.TRANSITION_CALLBACK_ERROR

    def to_label(self) -> str:
        """Return the label of the transition that follows."""
        return f"transition_{self.name.lower()}"


class ManagedEntity:
    """Base class: a callback for each transition, which takes the previous state."""

    def _by_default(self, callback: str, state: Any) -> TransitionCallbackReturn:
        """Do what a callback does that is not overridden."""
        return TransitionCallbackReturn.SUCCESS

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        return self._by_default("on_configure", state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        return self._by_default("on_cleanup", state)

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        return self._by_default("on_shutdown", state)

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        return self._by_default("on_activate", state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        return self._by_default("on_deactivate", state)

    def on_error(self, state: Any) -> TransitionCallbackReturn:
        """Clean up after an error: success leads to the state unconfigured, all else to finalized."""
        return self._by_default("on_error", state)


class SimpleManagedEntity(ManagedEntity):
    """Knows only whether it is active."""

    def __init__(self) -> None:
        self.is_activated = False

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        self.is_activated = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        self.is_activated = False
        return TransitionCallbackReturn.SUCCESS

    @staticmethod
    def when_enabled(
        wrapped: Callable[..., Any] | None = None, *, when_not_enabled: Callable[[], Any] | None = None
    ) -> Callable[..., Any]:
        """Decorate a method that does something only while the entity is active; else `when_not_enabled` is called."""

        def decorator(method: Callable[..., Any]) -> Callable[..., Any]:
            @wraps(method)
            def only_when_enabled(self: SimpleManagedEntity, *args: Any, **kwargs: Any) -> None:
                if self.is_activated:
                    method(self, *args, **kwargs)
                elif when_not_enabled is not None:
                    when_not_enabled()

            return only_when_enabled

        return decorator if wrapped is None else decorator(wrapped)
