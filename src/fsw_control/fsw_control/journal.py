"""What operators can ask for and what can become of an alarm: enums of the messages that record both."""

from __future__ import annotations

from fsw_control.coded import Coded


class RequestKind(Coded):
    """What was asked for on the operator's page; numbered as in ``OperatorAction.msg``, named as the requests are."""

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
    #: nobody asked for it: control ended without being released
    LOSE_CONTROL = 19

    @classmethod
    def of(cls, name: str) -> RequestKind:
        """Kind of a request by its name, e.g. ``set_reference``."""
        return cls.__members__.get(name.upper(), cls.UNKNOWN)


class AlarmChange(Coded):
    """What became of an alarm; numbered as in ``AlarmEvent.msg``."""

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
