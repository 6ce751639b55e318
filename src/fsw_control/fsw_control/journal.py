"""Operator requests and changes of alarms: enums of the messages that record both."""

from __future__ import annotations

from fsw_control.coded import Coded


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
