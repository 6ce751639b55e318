"""Loggers, with filters by place in the code."""

from __future__ import annotations

import os
import sys
from types import FrameType
from typing import Any, NamedTuple

from rclpy import logging_rosout
from rclpy.clock import Clock
from rclpy.impl.logging_output import SEPARATOR, system
from rclpy.impl.logging_severity import LoggingSeverity

#: Files whose frames are not the caller of a logging method; wrappers around a logger may add theirs.
_internal_callers: list[str] = [__file__]


class CallerId(NamedTuple):
    """Place in the code from which a message is logged."""

    function_name: str
    file_path: str
    line_number: int
    #: Index of the instruction: two calls on one line differ.
    last_index: int

    @classmethod
    def current(cls) -> CallerId:
        """Return the first caller outside of the logging modules."""
        frame: FrameType = sys._getframe(1)
        while frame.f_back is not None and any(path in frame.f_code.co_filename for path in _internal_callers):
            frame = frame.f_back
        code = frame.f_code
        return cls(code.co_name, os.path.abspath(code.co_filename), frame.f_lineno, frame.f_lasti)


class Throttle:
    """Lets a message pass if the last one that passed is at least a duration ago."""

    params = {"throttle_duration_sec": None, "throttle_time_source_type": Clock()}

    def __init__(self, throttle_duration_sec: float, throttle_time_source_type: Clock) -> None:
        if not isinstance(throttle_time_source_type, Clock):
            raise ValueError(
                f'Received throttle_time_source_type of "{throttle_time_source_type}" is not a clock instance'
            )
        self._clock = throttle_time_source_type
        self._duration_ns = throttle_duration_sec * 1e9
        self._last_ns = 0

    def should_log(self) -> bool:
        """Decide about one message."""
        now_ns = self._clock.now().nanoseconds
        if now_ns < self._last_ns + self._duration_ns:
            return False
        self._last_ns = now_ns
        return True


class SkipFirst:
    """Holds back the first message."""

    params: dict[str, Any] = {"skip_first": None}

    def __init__(self, skip_first: bool) -> None:
        self._first = True

    def should_log(self) -> bool:
        """Decide about one message."""
        first, self._first = self._first, False
        return not first


class Once:
    """Lets the first message pass only."""

    params: dict[str, Any] = {"once": None}

    def __init__(self, once: bool) -> None:
        self._first = True

    def should_log(self) -> bool:
        """Decide about one message."""
        first, self._first = self._first, False
        return first


#: Filters in the order in which they are asked. A parameter whose default is None is required.
supported_filters: dict[str, Any] = {"throttle": Throttle, "skip_first": SkipFirst, "once": Once}
_PARAMETERS = [name for kind in supported_filters.values() for name in kind.params]


def _requested_filters(kwargs: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the complete parameters of every filter that `kwargs` asks for; TypeError if they make no sense."""
    requested: dict[str, dict[str, Any]] = {}
    for name, kind in supported_filters.items():
        if not any(kwargs.get(parameter) for parameter in kind.params):
            continue
        requested[name] = {parameter: kwargs.get(parameter, default) for parameter, default in kind.params.items()}
        for parameter, value in requested[name].items():
            if value is None:
                raise TypeError(
                    f'required parameter "{parameter}" not specified '
                    f'but is required for the the logging filter "{name}"'
                )
    for parameter in kwargs:
        if parameter not in _PARAMETERS:
            raise TypeError(f'parameter "{parameter}" is not one of the recognized logging options "{_PARAMETERS}"')
    return requested


class _CallSite:
    """What the first call at a place asked for, and the state of its filters."""

    def __init__(self, severity: LoggingSeverity, name: str, requested: dict[str, dict[str, Any]]) -> None:
        self.severity = severity
        self.name = name
        self.requested = requested
        self.filters = [supported_filters[key](**parameters) for key, parameters in requested.items()]

    def check_unchanged(self, severity: LoggingSeverity, name: str, requested: dict[str, dict[str, Any]]) -> None:
        """Raise ValueError if a later call at the place asks for something else."""
        if severity != self.severity:
            raise ValueError("Logger severity cannot be changed between calls.")
        if name != self.name:
            raise ValueError("Logger name cannot be changed between calls.")
        if requested.keys() != self.requested.keys():
            raise ValueError("Requested logging filters cannot be changed between calls.")
        if requested != self.requested:
            raise ValueError("Logging filter parameters cannot be changed between calls.")


class RcutilsLogger:
    """A named logger. Loggers form a hierarchy by the dots in their names and inherit levels along it."""

    def __init__(self, name: str = "") -> None:
        self.name = name
        self._publishes_for: str | None = None
        self._call_sites: dict[CallerId, _CallSite] = {}

    def __del__(self) -> None:
        if self._publishes_for is not None:
            logging_rosout.remove_child(self.name)

    def get_child(self, name: str) -> RcutilsLogger:
        """Return a logger below this one; ValueError if the name is empty.

        If this logger publishes to /rosout, so does the child.
        """
        if not name:
            raise ValueError("Child logger name must not be empty.")
        child = RcutilsLogger(f"{self.name}{SEPARATOR}{name}" if self.name else name)
        if self.name and logging_rosout.add_child(self.name, child.name):
            child._publishes_for = self.name
        return child

    def set_level(self, level: LoggingSeverity | int) -> None:
        """Set the level; UNSET means that of the parent."""
        system.set_level(self.name, LoggingSeverity(level))

    def get_effective_level(self) -> LoggingSeverity:
        """Return the level, or that of the nearest ancestor that has one."""
        return system.effective_level(self.name)

    def is_enabled_for(self, severity: LoggingSeverity | int) -> bool:
        """Return whether messages of a severity are logged."""
        return LoggingSeverity(severity) >= system.effective_level(self.name)

    def log(self, message: str, severity: LoggingSeverity | int, **kwargs: Any) -> bool:
        """Log a message.

        Parameters
        ----------
        message : str
            The text.
        severity : LoggingSeverity
            Its severity.
        name : str, optional
            Logger to name instead of this one.
        throttle_duration_sec : float, optional
            Drop the message if the last one from this place is less than this long ago.
        throttle_time_source_type : Clock, optional
            Clock for that; system time if not given.
        skip_first : bool, optional
            Drop the first message from this place.
        once : bool, optional
            Drop all but the first message from this place.

        Returns
        -------
        bool
            False if the level or a filter dropped the message.

        Raises
        ------
        TypeError
            If the message is not a string, or the options are unknown or incomplete.
        ValueError
            If severity, name or options differ from those of an earlier call at the same place.
        """
        severity = LoggingSeverity(severity)
        if severity < system.effective_level(self.name):
            return False
        name = kwargs.pop("name", self.name)
        requested = _requested_filters(kwargs)
        if not isinstance(message, str):
            raise TypeError(f"a log message must be a str, got {type(message).__name__}: use str(...)")
        caller = CallerId.current()
        site = self._call_sites.get(caller)
        if site is None:
            site = self._call_sites[caller] = _CallSite(severity, name, requested)
        else:
            site.check_unchanged(severity, name, requested)
        if not all(filter_.should_log() for filter_ in site.filters):
            return False
        system.log(severity, name, message, caller.function_name, caller.file_path, caller.line_number)
        return True

    def debug(self, message: str, **kwargs: Any) -> bool:
        """Log with severity DEBUG; see `log`."""
        return self.log(message, LoggingSeverity.DEBUG, **kwargs)

    def info(self, message: str, **kwargs: Any) -> bool:
        """Log with severity INFO; see `log`."""
        return self.log(message, LoggingSeverity.INFO, **kwargs)

    def warning(self, message: str, **kwargs: Any) -> bool:
        """Log with severity WARN; see `log`."""
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def warn(self, message: str, **kwargs: Any) -> bool:
        """Log with severity WARN; the older name of `warning`."""
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def error(self, message: str, **kwargs: Any) -> bool:
        """Log with severity ERROR; see `log`."""
        return self.log(message, LoggingSeverity.ERROR, **kwargs)

    def fatal(self, message: str, **kwargs: Any) -> bool:
        """Log with severity FATAL; see `log`."""
        return self.log(message, LoggingSeverity.FATAL, **kwargs)
