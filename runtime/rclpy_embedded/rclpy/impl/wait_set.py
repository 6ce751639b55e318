"""What an executor sleeps on: DDS conditions that can come and go, and a way to be woken."""

import threading
from collections.abc import Iterable
from typing import Any, Self

from cyclonedds.core import DDSException, Entity, GuardCondition, WaitSet
from rclpy.impl.dds import delete
from rclpy.impl.session import Session

# Upper limit of one wait, so that Python handles signals even where no handler of ours wakes the wait set.
_LONGEST_WAIT_NS = 1_000_000_000


class ConditionSet:
    """DDS conditions and a guard to end the wait for them. Only `wake` may be called from other threads."""

    def __init__(self, session: Session) -> None:
        self._participant = session.participant
        self._guard: Any = GuardCondition(self._participant)
        self._guard_lock = threading.Lock()
        self._woken = False
        self._attached: dict[int, Entity] = {}
        self._waitset = self._new()

    def _new(self) -> WaitSet:
        waitset = WaitSet(self._participant)
        waitset.attach(self._guard)
        return waitset

    def wake(self) -> None:
        """End the present wait, or the next one."""
        with self._guard_lock:
            if not self._woken and self._guard is not None:
                self._woken = True
                try:
                    self._guard.set(True)
                except DDSException:  # the participant is gone, so there is nothing to wait for
                    pass

    def update(self, conditions: Iterable[Entity]) -> None:
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def close(self) -> None:
        with self._guard_lock:
            delete(self._waitset)
            delete(self._guard)
            self._guard = None
