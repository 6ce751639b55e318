"""Callback groups: which callbacks may run concurrently."""

import weakref
from typing import Any


class CallbackGroup:
    """Base class. With a single thread, groups matter only for callbacks that are coroutines."""

    def __init__(self) -> None:
        self.entities: set[weakref.ref[Any]] = set()

    def add_entity(self, entity: Any) -> None:
        """Add a subscription, timer, client, service, guard condition or waitable."""
        self.entities.add(weakref.ref(entity))

    def has_entity(self, entity: Any) -> bool:
        return weakref.ref(entity) in self.entities

    def can_execute(self, entity: Any) -> bool:
        return True

    def beginning_execution(self, entity: Any) -> bool:
        """Mark the entity's callback as running; return False if it must not start."""
        return True

    def ending_execution(self, entity: Any) -> None:
        """Mark the entity's callback as finished."""


class ReentrantCallbackGroup(CallbackGroup):
    """Callbacks may overlap without restriction."""


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """One callback at a time."""

    _active_entity: Any = None

    def can_execute(self, entity: Any) -> bool:
        return self._active_entity is None

    def beginning_execution(self, entity: Any) -> bool:
        if self._active_entity is not None:
            return False
        self._active_entity = entity
        return True

    def ending_execution(self, entity: Any) -> None:
        self._active_entity = None
