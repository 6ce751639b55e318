"""The states of a managed node and the transitions between them, numbered and named as in rcl_lifecycle."""

from __future__ import annotations

from collections.abc import Callable

from lifecycle_msgs.msg import State, Transition
from rclpy._rclpy_pybind11 import RCLError

_STATES: dict[int, str] = {
    getattr(State, f"{kind}_STATE_{name.upper()}"): name
    for kind, names in (
        ("PRIMARY", ("unknown", "unconfigured", "inactive", "active", "finalized")),
        (
            "TRANSITION",
            ("configuring", "cleaningup", "shuttingdown", "activating", "deactivating", "errorprocessing"),
        ),
    )
    for name in names
}
_IDS = {name: state_id for state_id, name in _STATES.items()}
#: Identifier and label, those of the state it starts from, and those of the one it leads to.
_Transition = tuple[int, str, int, str, int, str]


def _transition(constant: str, label: str, start: str, goal: str) -> _Transition:
    return getattr(Transition, f"TRANSITION_{constant}"), label, _IDS[start], start, _IDS[goal], goal


def _outcomes(name: str, start: str, success: str, failure: str, error: str = "errorprocessing") -> list[_Transition]:
    goals = {"success": success, "failure": failure, "error": error}
    return [
        _transition(f"ON_{name}_{outcome.upper()}", f"transition_{outcome}", start, goal)
        for outcome, goal in goals.items()
    ]


def _transitions() -> list[_Transition]:
    found: list[_Transition] = []
    for label, start, during, success in (
        ("configure", "unconfigured", "configuring", "inactive"),
        ("cleanup", "inactive", "cleaningup", "unconfigured"),
        ("activate", "inactive", "activating", "active"),
        ("deactivate", "active", "deactivating", "inactive"),
    ):
        found.append(_transition(label.upper(), label, start, during))
        found += _outcomes(label.upper(), during, success, start)
    for start in ("unconfigured", "inactive", "active"):
        found.append(_transition(f"{start.upper()}_SHUTDOWN", "shutdown", start, "shuttingdown"))
    found += _outcomes("SHUTDOWN", "shuttingdown", "finalized", "finalized")
    return found + _outcomes("ERROR", "errorprocessing", "unconfigured", "finalized", "finalized")


_TRANSITIONS = _transitions()


class LifecycleStateMachine:
    """The state of one node; `notify` learns the identifiers of the old and the new state at every transition."""

    #: Identifiers and labels of all states.
    available_states = tuple(_STATES.items())
    #: All transitions.
    transition_graph = _TRANSITIONS

    def __init__(self, notify: Callable[[int, int], None]) -> None:
        self._notify = notify
        self._state: int = State.PRIMARY_STATE_UNCONFIGURED

    @property
    def current_state(self) -> tuple[int, str]:
        """Identifier and label of the state."""
        return self._state, _STATES[self._state]

    @property
    def available_transitions(self) -> list[_Transition]:
        """Those that start from the present state."""
        return [transition for transition in _TRANSITIONS if transition[2] == self._state]

    def get_transition_by_label(self, label: str) -> int:
        """Return the identifier of a transition that starts from the present state; RCLError if there is none."""
        for transition in self.available_transitions:
            if transition[1] == label:
                return transition[0]
        raise RCLError(f"No transition matching {label} found for current state {self.current_state[1]}")

    def trigger_transition(self, transition_id: int) -> None:
        """Change the state; RCLError if no such transition starts from the present one."""
        for number, _, start, _, goal, _ in self.available_transitions:
            if number == transition_id:
                self._state = goal
                self._notify(start, goal)
                return
        raise RCLError(f"No transition matching {transition_id} found for current state {self.current_state[1]}")
