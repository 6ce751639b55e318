"""Enumerations of messages: interlocks, changes of mode, requests of operators, alarms."""

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

    STARTED = 0, "start"
    READY = 1, "start"
    ABANDONED = 2, "start"
    INTERRUPTED = 3, "gap in the measurements"
    OPERATOR_AUTO = 4, "operator"
    OPERATOR_MANUAL = 5, "operator"
    OPERATOR_HOLD = 6, "operator"
    OPERATOR_SAFE_STOP = 7, "operator"
    NO_CONTROLLER = 8, "no controller is usable"
    STORM = 9, "too many swaps"
    CONTROLLER_BACK = 10, "a controller is ready again"
    HOLD_TIMEOUT = 11, "held too long"
    START_TIMEOUT = 12, "waited too long for a controller"
    BLIND_TIMEOUT = 13, "a sensor is invalid for too long"
    RESTARTED = 14, "safe stop before the restart"
    STOP_HEARD = 15, "safe stop of another part"
    INTERLOCK_TRIP = 16, "interlock"
    CLOCK_STOPPED = 17, "stamps do not advance"
    #: another controller in auto: at an operator's request, because the previous one failed, or
    #: because it is ready again
    SWAP_REQUESTED = 18, "operator"
    SWAP_FAILED = 19, "failover"
    SWAP_BACK = 20, "the selected controller is ready again"
    #: a cause that this version does not know
    UNKNOWN = 255, "cause not on record"

    @property
    def on_request(self) -> bool:
        """Whether an operator requested it."""
        return (
            Cause.OPERATOR_AUTO <= self <= Cause.OPERATOR_SAFE_STOP or self is Cause.SWAP_REQUESTED
        )

    @property
    def at_start(self) -> bool:
        """Whether it belongs to the start of control, including a restart after a gap."""
        return self <= Cause.INTERRUPTED


class RequestKind(Coded):
    """Request on the operator page; numbered as in ``OperatorAction.msg``."""

    UNKNOWN = 0
    SAFE_STOP = 1
    ACKNOWLEDGE_STOP = 2
    SET_REFERENCE = 3
    SWITCH = 4
    MODE = 5
    WELD = 6
    ACKNOWLEDGE = 7
    SHELVE = 8
    UNSHELVE = 9
    DISTURB = 10
    FAULT = 11
    LOGIN = 12
    TAKE_CONTROL = 13
    RELEASE_CONTROL = 14
    REQUEST_CONTROL = 15
    WITHDRAW_REQUEST = 16
    HAND_OVER_CONTROL = 17
    KEEP_CONTROL = 18
    #: not a request: control ended without being released
    LOSE_CONTROL = 19

    @classmethod
    def of(cls, name: str) -> RequestKind:
        """Return the kind of a request from its name, e.g. ``set_reference``."""
        return cls.__members__.get(name.upper(), cls.UNKNOWN)


class AlarmChange(Coded):
    """Change of an alarm; numbered as in ``AlarmEvent.msg``."""

    UNKNOWN = 0
    RAISED = 1
    RE_RAISED = 2
    WORSENED = 3
    CLEARED = 4
    ACKNOWLEDGED = 5
    SHELVED = 6
    UNSHELVED = 7

    @property
    def word(self) -> str:
        """Its name in small letters, e.g. ``re-raised``."""
        return super().word.replace("_", "-")
