"""Managed nodes (ROS 2 lifecycle): each transition is undone by its opposite."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Result

from fsw_control.light_node_ros import LightNode

#: attributes that list a node's entities, and the methods that destroy them
_ENTITIES = {
    "timers": "destroy_timer",
    "subscriptions": "destroy_subscription",
    "services": "destroy_service",
    "clients": "destroy_client",
    "guards": "destroy_guard_condition",
    "publishers": "destroy_publisher",
}


class ManagedNode(LightNode, LifecycleNode):
    """Base of managed nodes; a subclass overrides its transitions and refuses one by raising.

    Publishers, subscriptions, services, clients and timers created in :meth:`configure` or
    :meth:`activate` are destroyed by the transition back.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.is_configured = self.is_active = False
        self._refusal: Exception | None = None
        self._starting = False
        self._kept: list[list[Any]] = []

    def start(self) -> None:
        """Configure and activate; if the subclass refuses, destroy the node and raise."""
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            self._refusal = None
            trigger()
            if self._refusal is not None:
                self.destroy_node()
                try:
                    raise self._refusal
                finally:
                    self._refusal = None  # its traceback would keep the node alive
        self._starting = False

    # to be overridden

    def configure(self) -> None:
        """Check all requirements and create what the node needs while inactive."""

    def activate(self) -> None:
        """Start operation."""

    def deactivate(self) -> None:
        """Stop operation and leave everything safe."""

    def cleanup(self) -> None:
        """Undo :meth:`configure`."""

    # the transitions

    def on_configure(self, state: LifecycleState) -> Result:
        """Configure."""
        self.is_configured = self._attempt("configure", self.configure)
        return Result.SUCCESS if self.is_configured else Result.FAILURE

    def on_activate(self, state: LifecycleState) -> Result:
        """Activate."""
        self.is_active = self._attempt("activate", self.activate)
        return Result.SUCCESS if self.is_active else Result.FAILURE

    def on_deactivate(self, state: LifecycleState) -> Result:
        """Deactivate."""
        self._leave_active()
        return Result.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> Result:
        """Clean up."""
        if self.is_configured:
            self.is_configured = False
            self._undo("clean up", self.cleanup)
        return Result.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> Result:
        """Deactivate and clean up, as far as necessary."""
        self._leave_active()
        return self.on_cleanup(state)

    def on_error(self, state: LifecycleState) -> Result:
        """As on shutdown, but the node may be configured again."""
        return self.on_shutdown(state)

    def _leave_active(self) -> None:
        if self.is_active:
            self.is_active = False
            self._undo("deactivate", self.deactivate)

    def _attempt(self, what: str, action: Callable[[], object]) -> bool:
        """Run a transition; if it is refused, undo it and return False."""
        self._kept.append(self._entities())
        try:
            action()
        except Exception as error:
            self._refusal = error
            if not self._starting:  # else the caller gets the exception
                self._log(f"cannot {what}", error)
            self._destroy_new()
            return False
        return True

    def _undo(self, what: str, action: Callable[[], object]) -> None:
        """Run a transition back; errors are logged and do not stop it."""
        try:
            action()
        except Exception as error:
            self._log(what, error)
        self._destroy_new()

    def _log(self, what: str, error: Exception) -> None:
        text = " ".join(str(error).split()) or type(error).__name__
        self.get_logger().error(f"{what}: {text}")

    def _entities(self) -> list[Any]:
        return [entity for listed in _ENTITIES for entity in getattr(self, listed)]

    def _destroy_new(self) -> None:
        """Destroy the entities created since the transition before."""
        kept = {id(entity) for entity in self._kept.pop()}
        for listed, destroy in _ENTITIES.items():
            for entity in [item for item in getattr(self, listed) if id(item) not in kept]:
                getattr(self, destroy)(entity)
