"""Publication of log messages on /rosout."""

from __future__ import annotations

import threading
from collections.abc import Callable

import rcl_interfaces.msg
from rclpy.impl.logging_output import LogRecord, system

Publish = Callable[["rcl_interfaces.msg.Log"], None]

_publishers: dict[str, list[Publish]] = {}
#: Name of a child -> (name of the logger that publishes for it, number of logger objects).
_children: dict[str, tuple[str, int]] = {}
_lock = threading.RLock()
_state = threading.local()


def attach(logger_name: str, publish: Publish) -> None:
    """Publish the messages of a node's logger and of its children through `publish`."""
    with _lock:
        publishers = _publishers.setdefault(logger_name, [])
        publishers.append(publish)
    if len(publishers) > 1:
        from rclpy.logging import get_logger

        get_logger("rcl.logging_rosout").warning(
            f"Publisher already registered for node name: '{logger_name}'. If this is due to multiple nodes with the "
            f"same name then all logs for the logger named '{logger_name}' will go out over the existing publisher."
        )


def detach(logger_name: str, publish: Publish) -> None:
    """Undo `attach`; harmless if it was not done."""
    with _lock:
        publishers = _publishers.get(logger_name, [])
        if publish in publishers:
            publishers.remove(publish)
        if not publishers:
            _publishers.pop(logger_name, None)


def add_child(logger_name: str, child_name: str) -> bool:
    """Let a child publish through its parent's publisher; False if the parent publishes nothing."""
    with _lock:
        owner = _children[logger_name][0] if logger_name in _children else logger_name
        if owner not in _publishers:
            return False
        _, count = _children.get(child_name, (owner, 0))
        _children[child_name] = owner, count + 1
        return True


def remove_child(child_name: str) -> None:
    """Undo one `add_child`."""
    with _lock:
        owner, count = _children.get(child_name, ("", 0))
        if count > 1:
            _children[child_name] = owner, count - 1
        else:
            _children.pop(child_name, None)


def _publish(record: LogRecord) -> None:
    with _lock:
        owner = record.name if record.name in _publishers else _children.get(record.name, ("", 0))[0]
        publishers = _publishers.get(owner)
        publish = publishers[0] if publishers else None
    # A message logged while publishing a message would go round for ever.
    if publish is None or getattr(_state, "publishing", False):
        return
    message = rcl_interfaces.msg.Log(
        level=int(record.severity),
        name=record.name,
        msg=record.message,
        file=record.file_name,
        function=record.function_name,
        line=record.line_number,
    )
    message.stamp.sec, message.stamp.nanosec = divmod(record.stamp_ns, 1_000_000_000)
    _state.publishing = True
    try:
        publish(message)
    except RuntimeError:
        # The publisher was destroyed meanwhile: logging must not fail for that.
        return
    finally:
        _state.publishing = False


system.rosout = _publish
