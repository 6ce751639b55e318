"""Why a weld is in its mode and under its controller; levels of its interlocks."""

from __future__ import annotations

from fsw_control.coded import Coded


class Severity(Coded):
    """Level of an interlock; numbered as in ``Interlock.msg``."""

    OK = 0
    WARN = 1
    TRIP = 2
    #: none that this version knows
    UNKNOWN = 255


class Cause(Coded):
    """Cause of the last change of mode or controller; numbered as in ``SupervisorState.msg``."""

    STARTED = 0
    READY = 1
    ABANDONED = 2
    INTERRUPTED = 3
    OPERATOR_AUTO = 4
    OPERATOR_MANUAL = 5
    OPERATOR_HOLD = 6
    OPERATOR_SAFE_STOP = 7
    NO_CONTROLLER = 8
    STORM = 9
    CONTROLLER_BACK = 10
    HOLD_TIMEOUT = 11
    START_TIMEOUT = 12
    BLIND_TIMEOUT = 13
    RESTARTED = 14
    STOP_HEARD = 15
    INTERLOCK_TRIP = 16
    CLOCK_STOPPED = 17
    #: another controller in auto: at an operator's request, because the previous one failed, or
    #: because it is ready again
    SWAP_REQUESTED = 18
    SWAP_FAILED = 19
    SWAP_BACK = 20
    #: a cause that this version does not know
    UNKNOWN = 255

    @property
    def words(self) -> str:
        """The cause in words."""
        return _WORDS[self]

    @property
    def on_request(self) -> bool:
        """Whether an operator requested it."""
        return self in _ON_REQUEST

    @property
    def at_start(self) -> bool:
        """Whether it belongs to the start of control, including a restart after a gap."""
        return self in _AT_START


_ON_REQUEST = {
    Cause.OPERATOR_AUTO,
    Cause.OPERATOR_MANUAL,
    Cause.OPERATOR_HOLD,
    Cause.OPERATOR_SAFE_STOP,
    Cause.SWAP_REQUESTED,
}
_AT_START = {Cause.STARTED, Cause.READY, Cause.ABANDONED, Cause.INTERRUPTED}
_WORDS = {
    Cause.STARTED: "start",
    Cause.READY: "start",
    Cause.ABANDONED: "start",
    Cause.INTERRUPTED: "gap in the measurements",
    Cause.OPERATOR_AUTO: "operator",
    Cause.OPERATOR_MANUAL: "operator",
    Cause.OPERATOR_HOLD: "operator",
    Cause.OPERATOR_SAFE_STOP: "operator",
    Cause.NO_CONTROLLER: "no controller is usable",
    Cause.STORM: "too many swaps",
    Cause.CONTROLLER_BACK: "a controller is ready again",
    Cause.HOLD_TIMEOUT: "held too long",
    Cause.START_TIMEOUT: "waited too long for a controller",
    Cause.BLIND_TIMEOUT: "a sensor is invalid for too long",
    Cause.RESTARTED: "safe stop before the restart",
    Cause.STOP_HEARD: "safe stop of another part",
    Cause.INTERLOCK_TRIP: "interlock",
    Cause.CLOCK_STOPPED: "stamps do not advance",
    Cause.SWAP_REQUESTED: "operator",
    Cause.SWAP_FAILED: "failover",
    Cause.SWAP_BACK: "the selected controller is ready again",
    Cause.UNKNOWN: "cause not on record",
}
