"""Logging: loggers by name and their levels."""

import os
from pathlib import Path

from rclpy.impl.logging_output import system
from rclpy.impl.logging_severity import LoggingSeverity as LoggingSeverity
from rclpy.impl.rcutils_logger import RcutilsLogger as RcutilsLogger

_root_logger = RcutilsLogger()


def get_logger(name: str) -> RcutilsLogger:
    if not name:
        raise ValueError("Logger name must not be empty.")
    return _root_logger.get_child(name)


def initialize() -> None:
    """Set up the logging system; importing this module has done so already."""


#: Reset all levels, and read the environment again.
shutdown = clear_config = system.initialize


def set_logger_level(name: str, level: int | LoggingSeverity, detailed_error: bool = False) -> None:
    """Set the level of a logger ('' is the root)."""
    system.set_level(name, LoggingSeverity(level))


get_logger_effective_level = system.effective_level
get_logger_level = system.level


def get_logging_severity_from_string(log_severity: str) -> LoggingSeverity:
    """Return the severity of a name in any case."""
    try:
        return LoggingSeverity[log_severity.upper()]
    except KeyError:
        raise RuntimeError("Failed to get severity name") from None


def get_logging_directory() -> Path:
    """Return the directory for log files: ROS_LOG_DIR, else ROS_HOME/log, else ~/.ros/log."""
    if directory := os.environ.get("ROS_LOG_DIR"):
        return Path(directory).expanduser()
    return Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "log"
