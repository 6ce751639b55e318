"""Services to read and set logger levels."""

from typing import Any

from rcl_interfaces.msg import LoggerLevel, SetLoggerLevelsResult
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rclpy.logging import get_logger_level, set_logger_level


class LoggingService:
    """The services ``get_logger_levels`` and ``set_logger_levels`` of a node."""

    def __init__(self, node: Any) -> None:
        node.create_service(GetLoggerLevels, f"{node.get_name()}/get_logger_levels", self._get_logger_levels)
        node.create_service(SetLoggerLevels, f"{node.get_name()}/set_logger_levels", self._set_logger_levels)

    def _get_logger_levels(self, request: Any, response: Any) -> Any:
        response.levels = [LoggerLevel(name=name, level=int(get_logger_level(name))) for name in request.names]
        return response

    def _set_logger_levels(self, request: Any, response: Any) -> Any:
        for wanted in request.levels:
            result = SetLoggerLevelsResult(successful=True)
            try:
                set_logger_level(wanted.name, wanted.level)
            except ValueError:
                result = SetLoggerLevelsResult(successful=False, reason="Failed reason: Invalid logger level.")
            response.results.append(result)
        return response
