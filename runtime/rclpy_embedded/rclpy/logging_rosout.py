"""Publication of log messages on /rosout."""

import threading
from collections.abc import Callable

from rcl_interfaces.msg import Log
from rclpy.impl.logging_output import LogRecord, system
from rclpy.impl.rcutils_logger import RcutilsLogger


class Rosout:
    """Publishes the messages of the loggers of nodes and of their children."""

    def __init__(self) -> None:
        self._publishers: dict[str, list[Callable[[Log], None]]] = {}
        # Name of a child -> name of the logger that publishes for it, number of logger objects.
        self._children: dict[str, tuple[str, int]] = {}
        self._lock = threading.RLock()
        self._state = threading.local()

    def attach(self, logger_name: str, publish: Callable[[Log], None]) -> None:
        """Publish the messages of a node's logger and of its children through `publish`."""
        with self._lock:
            publishers = self._publishers.setdefault(logger_name, [])
            publishers.append(publish)
        if len(publishers) > 1:
            RcutilsLogger("rcl.logging_rosout").warning(
                f"Publisher already registered for node name: '{logger_name}'. If this is due to multiple nodes with "
                f"the same name then all logs for the logger named '{logger_name}' will go out over the existing "
                "publisher."
            )

    def detach(self, logger_name: str, publish: Callable[[Log], None]) -> None:
        """Undo `attach`."""
        with self._lock:
            publishers = self._publishers.get(logger_name, [])
            if publish in publishers:
                publishers.remove(publish)
            if not publishers:
                self._publishers.pop(logger_name, None)

    def add_child(self, logger_name: str, child_name: str) -> bool:
        """Let a child publish through its parent's publisher; False if the parent publishes nothing."""
        with self._lock:
            owner = self._children.get(logger_name, (logger_name, 0))[0]
            if owner not in self._publishers:
                return False
            self._children[child_name] = owner, self._children.get(child_name, ("", 0))[1] + 1
            return True

    def remove_child(self, child_name: str) -> None:
        """Undo one `add_child`."""
        with self._lock:
            owner, count = self._children.pop(child_name, ("", 0))
            if count > 1:
                self._children[child_name] = owner, count - 1

    def publish(self, record: LogRecord) -> None:
        """Publish a message if it is one of a node."""
        with self._lock:
            name = record.name if record.name in self._publishers else self._children.get(record.name, ("", 0))[0]
            publishers = self._publishers.get(name, [])[:1]
        # A message that is logged while another one is published would never come to an end.
        if not publishers or getattr(self._state, "publishing", False):
            return
        message = Log(
            level=int(record.severity),
            name=record.name,
            msg=record.message,
            file=record.file_name,
            function=record.function_name,
            line=record.line_number,
        )
        message.stamp.sec, message.stamp.nanosec = divmod(record.stamp_ns, 1_000_000_000)
        self._state.publishing = True
        try:
            publishers[0](message)
        except RuntimeError:
            # The publisher was destroyed meanwhile: logging must not fail for that.
            return
        finally:
            self._state.publishing = False


rosout = system.rosout = Rosout()
