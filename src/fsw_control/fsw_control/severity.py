"""Levels of interlocks."""

from __future__ import annotations

from fsw_control.coded import Coded


class Severity(Coded):
    """Level of an interlock; numbered as in ``Interlock.msg``."""

    OK = 0
    WARN = 1
    TRIP = 2
    #: none that this version knows
    UNKNOWN = 255
