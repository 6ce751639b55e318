"""Loggers: levels, filters, the console, /rosout."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from rcl_interfaces.msg import Log
from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.logging import LoggingSeverity, get_logger, get_logger_effective_level, set_logger_level
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

ROSOUT = QoSProfile(depth=100, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def logger() -> Iterator[Any]:
    """A logger at level INFO."""
    logger = get_logger("conformance")
    logger.set_level(LoggingSeverity.INFO)
    yield logger
    logger.set_level(LoggingSeverity.UNSET)


def test_levels(logger: Any) -> None:
    assert logger.get_effective_level() == LoggingSeverity.INFO
    assert not logger.is_enabled_for(LoggingSeverity.DEBUG) and logger.is_enabled_for(LoggingSeverity.INFO)
    assert logger.debug("quiet") is False
    # One place in the source has one severity, so this is no loop.
    assert logger.info("loud") and logger.warning("loud") and logger.error("loud") and logger.fatal("loud")
    child = logger.get_child("child")
    assert child.name == "conformance.child"
    assert get_logger_effective_level(child.name) == LoggingSeverity.INFO
    set_logger_level("conformance", LoggingSeverity.FATAL)
    assert child.error("quiet") is False


def test_console(logger: Any, capfd: pytest.CaptureFixture[str]) -> None:
    logger.warning("two words")
    logger.info("more")
    lines = capfd.readouterr().err.splitlines()
    assert re.search(r"\[WARN\] \[\d+\.\d{9}\] \[conformance\]: two words", lines[0])
    assert re.search(r"\[INFO\] \[\d+\.\d{9}\] \[conformance\]: more", lines[1])


def test_once_skip_first_throttle(logger: Any) -> None:
    assert [logger.info("once", once=True) for _ in range(3)] == [True, False, False]
    assert [logger.info("skip", skip_first=True) for _ in range(3)] == [False, True, True]
    clock = Clock()
    throttled = [logger.info("throttle", throttle_duration_sec=60, throttle_time_source_type=clock) for _ in range(3)]
    assert throttled == [True, False, False]
    with pytest.raises(ValueError):
        for _ in range(2):
            logger.log("changing severity", LoggingSeverity.INFO if _ else LoggingSeverity.ERROR)


def test_rosout(context: Context, node: Any, spinner: Any) -> None:
    logs: list[Any] = []
    node.create_subscription(Log, "/rosout", logs.append, ROSOUT)
    other = rclpy.create_node("other", namespace="/far", context=context)
    other.get_logger().error("broken")
    other.get_logger().debug("never seen")
    other.get_logger().get_child("part").warning("worn")
    assert spinner.until(lambda: {"broken", "worn"} <= {log.msg for log in logs})
    (broken,) = [log for log in logs if log.msg == "broken"]
    assert (broken.name, broken.level) == ("far.other", 40)
    assert broken.file.endswith("test_conformance_logging.py") and broken.function == "test_rosout" and broken.line > 0
    assert next(log for log in logs if log.msg == "worn").name == "far.other.part"
    assert not any(log.msg == "never seen" for log in logs)
    # Late joiners get what was said before.
    late: list[Any] = []
    node.create_subscription(Log, "/rosout", late.append, ROSOUT)
    assert spinner.until(lambda: any(log.msg == "broken" for log in late))
    other.destroy_node()


def test_rosout_knows_children_by_name(context: Context, node: Any, spinner: Any) -> None:
    logs: list[Any] = []
    node.create_subscription(Log, "/rosout", logs.append, ROSOUT)
    too_early = get_logger("far.other").get_child("early")
    other = rclpy.create_node("other", namespace="/far", context=context)
    too_early.info("before there was the node")
    one, two = (other.get_logger().get_child("part") for _ in range(2))
    same_name = get_logger("far.other.part")
    same_name.info("while two live")
    del one
    same_name.info("while one lives")
    other.get_logger().info("in its name", name="far.other.part")
    two.get_child("bolt").info("of a child that is gone")
    get_logger("far.other.part.bolt").info("that was the last one")
    del two
    same_name.info("while none lives")
    get_logger("far.other.none").info("of no child")
    other.get_logger().info("the end")
    assert spinner.until(lambda: any(log.msg == "the end" for log in logs))
    heard = [log.msg for log in logs if log.name.startswith("far.")]
    said = ["while two live", "while one lives", "in its name", "of a child that is gone", "the end"]
    assert heard == said
    other.destroy_node()


def test_no_rosout(context: Context, wait_until: Any) -> None:
    node = rclpy.create_node("silent", context=context, enable_rosout=False)
    assert wait_until(lambda: node.count_publishers("/parameter_events") == 1)
    assert node.count_publishers("/rosout") == 0
    node.destroy_node()
