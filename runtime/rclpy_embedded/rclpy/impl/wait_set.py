"""What an executor sleeps on: DDS conditions that can come and go, what waitables add, and a way to be woken."""

import threading
from collections.abc import Iterable
from typing import Any

from cyclonedds import core
from rclpy.impl.dds import Readable, delete
from rclpy.impl.session import Reader, Session

# Upper limit of one wait, so that Python handles signals even where no handler of ours wakes the wait set.
_LONGEST_WAIT_NS = 1_000_000_000


class WaitSet:
    """DDS conditions and a guard to end the wait for them. Only `wake` may be called from other threads.

    Waitables add handles of other entities, of which each has a condition or tells how long to wait.
    """

    def __init__(self, session: Session) -> None:
        self._participant = session.participant
        self._guard: Any = core.GuardCondition(self._participant)
        self._guard_lock = threading.Lock()
        self._woken = False
        self._attached: dict[int, core.Entity] = {}
        self._waitset = self._new()
        #: What waitables have added.
        self.added: list[Any] = []

    def _add(self, handle: Any) -> int:
        """Add an entity by its handle; return its number, which `is_ready` takes."""
        self.added.append(Readable(handle) if isinstance(handle, Reader) else handle)
        return len(self.added) - 1

    add_subscription = add_client = add_service = add_timer = add_guard_condition = add_event = _add

    def is_ready(self, entity_type: str, index: int) -> bool:
        """Return whether there is something to take from an entity; a guard condition is not ready again after that."""
        entity = self.added[index]
        ready: bool = entity._wait_ns() == 0
        if ready and entity_type == "guard_condition":
            entity._take()
        return ready

    def _new(self) -> core.WaitSet:
        waitset = core.WaitSet(self._participant)
        waitset.attach(self._guard)
        return waitset

    def wake(self) -> None:
        """End the present wait, or the next one."""
        with self._guard_lock:
            if not self._woken and self._guard is not None:
                self._woken = True
                try:
                    self._guard.set(True)
                except core.DDSException:  # the participant is gone, so there is nothing to wait for
                    pass

    def update(self, conditions: Iterable[core.Entity]) -> None:
        """Replace the conditions to wait for; former ones may have been deleted."""
        wanted = {id(condition): condition for condition in conditions}
        stale = [condition for key, condition in self._attached.items() if key not in wanted]
        if any(condition._ref not in condition._entities for condition in stale):
            # A deleted entity cannot be detached by the Python API, and would stay in its list for ever.
            delete(self._waitset)
            self._waitset = self._new()
            self._attached = {}
        else:
            for condition in stale:
                self._waitset.detach(condition)
                del self._attached[id(condition)]
        for key, condition in wanted.items():
            if key not in self._attached:
                self._waitset.attach(condition)
                self._attached[key] = condition

    def wait(self, timeout_ns: int) -> int:
        """Sleep until something triggers; return how many conditions did, not counting the guard."""
        triggered = int(self._waitset.wait(min(timeout_ns, _LONGEST_WAIT_NS)))
        if self._woken:
            with self._guard_lock:
                # In this order: an interrupt in between may delay a later wake, but must not leave the guard set.
                self._guard.set(False)
                self._woken = False
            triggered -= 1
        return max(0, triggered)

    def close(self) -> None:
        with self._guard_lock:
            delete(self._waitset)
            delete(self._guard)
            self._guard = None
