"""The states of a managed node and the transitions between them, numbered and named as in rcl_lifecycle."""

from __future__ import annotations

from collections.abc import Callable

from lifecycle_msgs.msg import State, Transition, TransitionDescription
from rclpy._rclpy_pybind11 import RCLError

_PRIMARY = ("unknown", "unconfigured", "inactive", "active", "finalized")
_PASSING = ("configuring", "cleaningup", "shuttingdown", "activating", "deactivating", "errorprocessing")
_STATES: dict[str, State] = {
    name: State(id=getattr(State, f"{kind}_STATE_{name.upper()}"), label=name)
    for kind, names in (("PRIMARY", _PRIMARY), ("TRANSITION", _PASSING))
    for name in names
}


def _transition(constant: str, label: str, start: str, goal: str) -> TransitionDescription:
    transition = Transition(id=getattr(Transition, f"TRANSITION_{constant}"), label=label)
    return TransitionDescription(transition=transition, start_state=_STATES[start], goal_state=_STATES[goal])


def _outcomes(
    name: str, start: str, success: str, failure: str, error: str = "errorprocessing"
) -> list[TransitionDescription]:
    goals = {"success": success, "failure": failure, "error": error}
    return [
        _transition(f"ON_{name}_{outcome.upper()}", f"transition_{outcome}", start, goal)
        for outcome, goal in goals.items()
    ]


def _transitions() -> list[TransitionDescription]:
    found: list[TransitionDescription] = []
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


class LifecycleStateMachine:
    """The state of one node; `notify` learns of every transition."""

    available_states = list(_STATES.values())
    #: All transitions.
    transition_graph = _transitions()

    def __init__(self, notify: Callable[[TransitionDescription], None]) -> None:
        self._notify = notify
        self._state = _STATES["unconfigured"]

    @property
    def current_state(self) -> tuple[int, str]:
        return self._state.id, self._state.label

    @property
    def available_transitions(self) -> list[TransitionDescription]:
        return [described for described in self.transition_graph if described.start_state == self._state]

    def get_transition_by_label(self, label: str) -> int:
        """Return the identifier of a transition that starts from the present state; RCLError if there is none."""
        return self._find(label).transition.id

    def trigger_transition(self, transition_id: int) -> None:
        """Change the state; RCLError if no such transition starts from the present one."""
        described = self._find(transition_id)
        self._state = described.goal_state
        self._notify(described)

    def _find(self, wanted: int | str) -> TransitionDescription:
        for described in self.available_transitions:
            if wanted in (described.transition.id, described.transition.label):
                return described
        raise RCLError(f"No transition matching {wanted} found for current state {self._state.label}")
