"""Levels of the loggers, and where messages go: the console and /rosout. Follows rcutils."""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections.abc import Callable
from typing import Any
from weakref import WeakSet

from rcl_interfaces import msg
from rclpy.impl.logging_severity import LoggingSeverity

DEFAULT_FORMAT = "[{severity}] [{time}] [{name}]: {message}"


_ESCAPES = {r"\a": "\a", r"\b": "\b", r"\n": "\n", r"\r": "\r", r"\t": "\t", r"\x1b": "\x1b"}
_NORMAL = "\033[0m"
_COLORS = {"DEBUG": "\033[32m", "INFO": _NORMAL, "WARN": "\033[33m", "ERROR": "\033[31m", "FATAL": "\033[31m"}


def _switch(name: str) -> bool | None:
    """Return an environment variable that is 0 or 1; None if it is not set or has another value."""
    value = os.environ.get(name, "")
    if value not in ("", "0", "1"):
        sys.stderr.write(f"Warning: unexpected value [{value}] specified for {name}. Valid values are 0 or 1.\n")
    return {"0": False, "1": True}.get(value)


def log_message(severity: int, name: str, text: str, function: str, file: str, line: int) -> msg.Log:
    """Make a message of a logger with its place in the code and the present time."""
    message = msg.Log(level=int(severity), name=name, msg=text, function=function, file=file, line=line)
    message.stamp.sec, message.stamp.nanosec = divmod(time.time_ns(), 1_000_000_000)
    return message


class Console:
    """Writes messages to stderr; the RCUTILS_* variables of the environment change stream, colour and layout."""

    def __init__(self) -> None:
        self._use_stdout = _switch("RCUTILS_LOGGING_USE_STDOUT") is True
        # Python buffers like C: stderr by line, stdout by line on a terminal only. Either value means a flush here.
        self._flush = _switch("RCUTILS_LOGGING_BUFFERED_STREAM") is not None
        self._colorized = _switch("RCUTILS_COLORIZED_OUTPUT")
        layout = os.environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or DEFAULT_FORMAT
        self._layout = re.sub(r"\\(?:[abnrt]|x1b)", lambda escape: _ESCAPES[escape[0]], layout)

    def format(self, record: msg.Log) -> str:
        """Return the message in the layout of the console, without colour."""
        seconds, nanoseconds = record.stamp.sec, record.stamp.nanosec
        date = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))
        values = {
            "severity": LoggingSeverity(record.level).name,
            "name": record.name,
            "message": record.msg,
            "function_name": record.function,
            "file_name": record.file,
            "line_number": str(record.line),
            "time": f"{seconds:010d}.{nanoseconds:09d}",
            "date_time_with_ms": f"{date}.{nanoseconds // 1_000_000:03d}",
            "time_as_nanoseconds": f"{seconds * 1_000_000_000 + nanoseconds:019d}",
        }
        return re.sub(r"{(\w+)}", lambda token: values.get(token[1], token[0]), self._layout)

    def __call__(self, record: msg.Log) -> None:
        """Write the message; a console that was closed is ignored."""
        stream = sys.stdout if self._use_stdout else sys.stderr
        if stream is None:
            return
        try:
            line = self.format(record)
            if stream.isatty() if self._colorized is None else self._colorized:
                line = f"{_COLORS[LoggingSeverity(record.level).name]}{line}{_NORMAL}"
            stream.write(line + "\n")
            if self._flush:
                stream.flush()
        except (OSError, ValueError):
            return


class LoggingSystem:
    """Levels by logger name and the outputs in use, among them /rosout; there is one per process."""

    def __init__(self) -> None:
        # What publishes to /rosout by name of a node's logger.
        self._publishers: dict[str, list[Callable[[Any], None]]] = {}
        # The same by name of a child of such a logger, and the children of that name that are still in use.
        self._children: dict[str, tuple[list[Callable[[Any], None]], WeakSet[Any]]] = {}
        self._state = threading.local()
        self.rosout_enabled = False
        self.initialize()

    def initialize(self) -> None:
        """Forget all levels and read the environment again."""
        # That of the root, whose name is empty, is the default of all.
        self._levels = {"": LoggingSeverity.INFO}
        self._console = Console()
        self.stdout_enabled = True

    def configure(self, arguments: Any) -> None:
        """Apply a command line (`rclpy.arguments.Arguments`): levels and outputs; called by the first context."""
        if arguments.default_log_level is not LoggingSeverity.UNSET:
            self._levels[""] = arguments.default_log_level
        self._levels.update(arguments.log_levels)
        self.stdout_enabled = arguments.stdout_logs
        self.rosout_enabled = arguments.rosout_logs

    def finish(self) -> None:
        """Return to console output only, and forget what published to /rosout; called after the last context."""
        self.stdout_enabled = True
        self.rosout_enabled = False
        self._publishers, self._children = {}, {}

    def attach(self, logger_name: str, publish: Callable[[Any], None]) -> None:
        """Publish the messages of a node's logger and of the children it will have through `publish`."""
        publishers = self._publishers.setdefault(logger_name, [])
        publishers.append(publish)
        if len(publishers) > 1:
            text = (
                f"Publisher already registered for node name: '{logger_name}'. Nodes of one name share the first one."
            )
            self.log(log_message(LoggingSeverity.WARN, "rcl.logging_rosout", text, "attach", __file__, 0))

    def detach(self, logger_name: str, publish: Callable[[Any], None]) -> None:
        publishers = self._publishers.get(logger_name, [])
        if publish in publishers:
            publishers.remove(publish)
        if not publishers:
            self._publishers.pop(logger_name, None)
            children = list(self._children.items())  # in one step, because another thread may add one
            self._children = {name: entry for name, entry in children if entry[0] is not publishers}

    def add_child(self, parent_name: str, child: Any) -> None:
        """Publish the messages under the name of a child as those of its parent, as long as the child is in use."""
        if publishers := self._publishers_of(parent_name):
            self._children.setdefault(child.name, (publishers, WeakSet()))[1].add(child)

    def _publishers_of(self, logger_name: str) -> list[Callable[[Any], None]]:
        publishers, children = self._children.get(logger_name, ([], ()))
        return self._publishers.get(logger_name) or (publishers if children else [])

    def _publish(self, message: msg.Log) -> None:
        """Publish a message if its logger is that of a node, or a child of one."""
        publishers = self._publishers_of(message.name)
        # A message logged while another one is published would cause an endless recursion.
        if not publishers or getattr(self._state, "publishing", False):
            return
        self._state.publishing = True
        try:
            publishers[0](message)
        except (RuntimeError, IndexError):
            # The publisher was destroyed meanwhile: logging must not fail for that.
            return
        finally:
            self._state.publishing = False

    def level(self, name: str) -> LoggingSeverity:
        """Return the level set for exactly this logger; UNSET if none is."""
        return self._levels.get(name, LoggingSeverity.UNSET)

    def set_level(self, name: str, level: LoggingSeverity) -> None:
        self._levels[name] = level

    def effective_level(self, name: str) -> LoggingSeverity:
        """Return the level of a logger or of its nearest ancestor that has one."""
        while name and not self.level(name):
            name = name.rpartition(".")[0]
        return self.level(name)

    def log(self, message: msg.Log) -> None:
        """Send a message to the outputs if the logger is enabled for it."""
        if message.level < self.effective_level(message.name) or message.level == LoggingSeverity.UNSET:
            return
        if self.stdout_enabled:
            self._console(message)
        if self.rosout_enabled:
            self._publish(message)


#: The logging system of this process.
system = LoggingSystem()
