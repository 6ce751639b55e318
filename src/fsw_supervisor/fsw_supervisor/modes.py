"""The arbiter's modes and the transitions between them, as data.

The diagram of ``docs/arbiter.md`` is generated from ``TRANSITIONS`` (see ``diagram.py``); a pair of mode and
trigger that is not in the table changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Mode(StrEnum):
    """What the arbiter does with a tick."""

    START = "start"
    AUTO = "auto"
    MANUAL = "manual"
    HOLD = "hold"
    SAFE_STOP = "safe_stop"


class Trigger(StrEnum):
    """What can make the mode change."""

    READY = "ready"
    ABANDONED = "abandoned"
    INTERRUPTED = "interrupted"
    OPERATOR_AUTO = "operator_auto"
    OPERATOR_MANUAL = "operator_manual"
    OPERATOR_HOLD = "operator_hold"
    OPERATOR_SAFE_STOP = "operator_safe_stop"
    NO_CONTROLLER = "no_controller"
    STORM = "storm"
    CONTROLLER_BACK = "controller_back"
    HOLD_TIMEOUT = "hold_timeout"
    INTERLOCK_TRIP = "interlock_trip"


#: the modes an operator can ask for, with the trigger that each fires
OPERATOR_TRIGGERS: dict[Mode, Trigger] = {
    Mode.AUTO: Trigger.OPERATOR_AUTO,
    Mode.MANUAL: Trigger.OPERATOR_MANUAL,
    Mode.HOLD: Trigger.OPERATOR_HOLD,
    Mode.SAFE_STOP: Trigger.OPERATOR_SAFE_STOP,
}


@dataclass(frozen=True, slots=True)
class Transition:
    """One row of the table.

    Attributes
    ----------
    source, target : Mode
        From where to where.
    trigger : Trigger
        What makes it happen.
    meaning : str
        When the trigger is fired, in words (shown in the diagram).
    """

    source: Mode
    trigger: Trigger
    target: Mode
    meaning: str


def _but(mode: Mode) -> tuple[Mode, ...]:
    return tuple(item for item in Mode if item is not mode)


TRANSITIONS: tuple[Transition, ...] = (
    Transition(Mode.START, Trigger.READY, Mode.AUTO, "first good proposal"),
    Transition(Mode.START, Trigger.ABANDONED, Mode.HOLD, "in mid-weld, the controller that was active is silent"),
    Transition(Mode.AUTO, Trigger.INTERRUPTED, Mode.START, "measurements are back after a gap"),
    *(Transition(m, Trigger.OPERATOR_AUTO, Mode.AUTO, "operator, a controller is ready") for m in _but(Mode.AUTO)),
    *(Transition(m, Trigger.OPERATOR_MANUAL, Mode.MANUAL, "operator, values in limits") for m in _but(Mode.MANUAL)),
    *(Transition(m, Trigger.OPERATOR_HOLD, Mode.HOLD, "operator") for m in _but(Mode.HOLD)),
    *(Transition(m, Trigger.OPERATOR_SAFE_STOP, Mode.SAFE_STOP, "operator") for m in _but(Mode.SAFE_STOP)),
    Transition(Mode.AUTO, Trigger.NO_CONTROLLER, Mode.HOLD, "no controller left that may be applied"),
    Transition(Mode.AUTO, Trigger.STORM, Mode.HOLD, "too many automatic swaps"),
    Transition(Mode.HOLD, Trigger.CONTROLLER_BACK, Mode.AUTO, "target auto, a controller is ready again"),
    Transition(Mode.HOLD, Trigger.HOLD_TIMEOUT, Mode.SAFE_STOP, "target auto, held too long"),
    *(Transition(m, Trigger.INTERLOCK_TRIP, Mode.SAFE_STOP, "an interlock trips") for m in _but(Mode.SAFE_STOP)),
)

_TABLE: dict[tuple[Mode, Trigger], Mode] = {(row.source, row.trigger): row.target for row in TRANSITIONS}


def next_mode(mode: Mode, trigger: Trigger) -> Mode | None:
    """Mode that ``trigger`` leads to from ``mode``; None where the table has no such row."""
    return _TABLE.get((mode, trigger))
