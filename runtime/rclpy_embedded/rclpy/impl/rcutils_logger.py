"""Loggers, with filters per call site."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Any

from rclpy.impl.logging_output import log_message, system
from rclpy.impl.logging_severity import LoggingSeverity

#: Files whose frames are not the caller of a logging method; wrappers around a logger may add theirs.
_internal_callers: list[str] = [__file__]


def _caller() -> tuple[str, str, int, int]:
    """Return function, file, line and instruction (two calls on a line differ) outside of the logging modules."""
    frame: FrameType = sys._getframe(1)
    while frame.f_back is not None and any(path in frame.f_code.co_filename for path in _internal_callers):
        frame = frame.f_back
    code = frame.f_code
    return code.co_name, os.path.abspath(code.co_filename), frame.f_lineno, frame.f_lasti


_OPTIONS = ["throttle_duration_sec", "throttle_time_source_type", "skip_first", "once"]


def _check_options(options: dict[str, Any]) -> None:
    for name in options:
        if name not in _OPTIONS:
            raise TypeError(f'parameter "{name}" is not one of the recognized logging options "{_OPTIONS}"')
    if clock := options.get("throttle_time_source_type"):
        if options.get("throttle_duration_sec") is None:
            raise TypeError(
                'required parameter "throttle_duration_sec" not specified '
                'but is required for the the logging filter "throttle"'
            )
        if not callable(getattr(clock, "now", None)):
            raise ValueError(f'Received throttle_time_source_type of "{clock}" is not a clock instance')


@dataclass
class _CallSite:
    """Arguments of the first call at a place in the code, and the state of the filters there."""

    severity: LoggingSeverity
    name: str
    options: dict[str, Any]
    last_ns: int = 0
    has_skipped: bool = False
    has_passed: bool = False

    def check_unchanged(self, severity: LoggingSeverity, name: str, options: dict[str, Any]) -> None:
        """Raise ValueError if a later call at the place has other arguments."""

        def filters(options: dict[str, Any]) -> set[str]:
            return {option.partition("_")[0] for option in options}

        for what, is_same in (
            ("Logger severity", severity == self.severity),
            ("Logger name", name == self.name),
            ("Requested logging filters", filters(options) == filters(self.options)),
            ("Logging filter parameters", options == self.options),
        ):
            if not is_same:
                raise ValueError(f"{what} cannot be changed between calls.")

    def passes(self) -> bool:
        """Return whether the filters pass this message: throttle, then skip first, then once."""
        options = self.options
        if duration_sec := options.get("throttle_duration_sec"):
            clock = options.get("throttle_time_source_type")
            now_ns = clock.now().nanoseconds if clock else time.time_ns()
            if now_ns < self.last_ns + duration_sec * 1e9:
                return False
            self.last_ns = now_ns
        if "skip_first" in options and not self.has_skipped:
            self.has_skipped = True
            return False
        if "once" in options and self.has_passed:
            return False
        self.has_passed = True
        return True


def _logging_at(severity: LoggingSeverity) -> Callable[..., bool]:
    def method(self: RcutilsLogger, message: str, **kwargs: Any) -> bool:
        return self.log(message, severity, **kwargs)

    return method


class RcutilsLogger:
    """A named logger. Loggers form a hierarchy by the dots in their names and inherit levels along it."""

    def __init__(self, name: str = "") -> None:
        self.name = name
        self._call_sites: dict[tuple[str, str, int, int], _CallSite] = {}

    def get_child(self, name: str) -> RcutilsLogger:
        """Return a logger below this one; if this one publishes to /rosout, so do all loggers of the child's name.

        They do so as long as the child is in use.
        """
        if not name:
            raise ValueError("Child logger name must not be empty.")
        child = RcutilsLogger(f"{self.name}.{name}" if self.name else name)
        system.add_child(self.name, child)
        return child

    def set_level(self, level: LoggingSeverity | int) -> None:
        """Set the level; UNSET inherits that of the parent."""
        system.set_level(self.name, LoggingSeverity(level))

    def get_effective_level(self) -> LoggingSeverity:
        """Return the level, or that of the nearest ancestor that has one."""
        return system.effective_level(self.name)

    def is_enabled_for(self, severity: LoggingSeverity | int) -> bool:
        return LoggingSeverity(severity) >= system.effective_level(self.name)

    def log(self, message: str, severity: LoggingSeverity | int, **kwargs: Any) -> bool:
        """Log a message, unless the level or a filter drops it; return whether it was logged.

        `throttle_duration_sec` (by the clock `throttle_time_source_type`), `skip_first` and `once` filter the messages
        of one call site, at which they and the severity must not change. `name` is that of another logger.
        """
        severity = LoggingSeverity(severity)
        if severity < system.effective_level(self.name):
            return False
        name = kwargs.pop("name", self.name)
        _check_options(kwargs)
        # An option that is False or 0 is ignored.
        options = {key: value for key, value in kwargs.items() if value}
        if not isinstance(message, str):
            raise TypeError(f"a log message must be a str, got {type(message).__name__}: use str(...)")
        caller = _caller()
        site = self._call_sites.setdefault(caller, _CallSite(severity, name, options))
        site.check_unchanged(severity, name, options)
        if not site.passes():
            return False
        system.log(log_message(severity, name, message, *caller[:3]))
        return True

    debug = _logging_at(LoggingSeverity.DEBUG)
    info = _logging_at(LoggingSeverity.INFO)
    warning = warn = _logging_at(LoggingSeverity.WARN)
    error = _logging_at(LoggingSeverity.ERROR)
    fatal = _logging_at(LoggingSeverity.FATAL)
