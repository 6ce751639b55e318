"""Loggers: levels, filters, console and /rosout."""

import inspect
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces.msg import Log
from rclpy.arguments import parse
from rclpy.clock import ROSClock
from rclpy.impl.logging_output import Console, system
from rclpy.logging import (
    LoggingSeverity,
    clear_config,
    get_logger,
    get_logger_effective_level,
    get_logger_level,
    get_logging_directory,
    get_logging_severity_from_string,
    set_logger_level,
)
from rclpy.time import Time

LEVELS = st.sampled_from(list(LoggingSeverity))
STAMP = Time(seconds=1_700_000_000, nanoseconds=12_345_678).to_msg()
RECORD = Log(level=30, name="a.b", msg="text {name}", function="func", file="/x/file.py", line=7, stamp=STAMP)


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    clear_config()
    yield
    clear_config()
    system.finish()


@given(st.dictionaries(st.sampled_from(["a", "a.b", "a.b.c", "ab", ""]), LEVELS))
def test_levels_are_inherited_along_the_dots(levels: dict[str, LoggingSeverity]) -> None:
    clear_config()
    get_logger_effective_level("a.b.c")
    for name, level in levels.items():
        set_logger_level(name, level)
    nearest = [levels[name] for name in ("a.b.c", "a.b", "a") if levels.get(name)]
    expected = nearest[0] if nearest else levels.get("", LoggingSeverity.INFO)
    assert get_logger_effective_level("a.b.c") is expected
    assert get_logger_level("a.b") is levels.get("a.b", LoggingSeverity.UNSET)
    assert get_logger("a.b.c").is_enabled_for(LoggingSeverity.WARN) is (expected <= LoggingSeverity.WARN)


def test_names_and_levels_are_checked() -> None:
    with pytest.raises(ValueError, match="Logger name must not be empty"):
        get_logger("")
    with pytest.raises(ValueError, match="Child logger name must not be empty"):
        get_logger("a").get_child("")
    assert get_logger("a").get_child("b").name == "a.b"
    with pytest.raises(ValueError):
        get_logger("a").set_level(11)
    assert get_logging_severity_from_string("warn") is LoggingSeverity.WARN
    with pytest.raises(RuntimeError):
        get_logging_severity_from_string("loud")


def test_filters() -> None:
    logger, clock = get_logger("filters"), ROSClock()
    clock._set_ros_time_is_active(True)
    passed: dict[str, list[int]] = {"once": [], "skip": [], "throttle": [], "both": [], "off": []}
    for second in range(6):
        clock.set_ros_time_override(Time(seconds=second))
        throttle = {"throttle_duration_sec": 2.0, "throttle_time_source_type": clock}
        for label, options in (("once", {"once": True}), ("skip", {"skip_first": True}), ("off", {"once": False})):
            # One place in the code per set of options: a place must not change them.
            if label == "once" and logger.info("x", **options):
                passed[label].append(second)
            if label == "skip" and logger.info("x", **options):
                passed[label].append(second)
            if label == "off" and logger.info("x", **options):
                passed[label].append(second)
        if logger.info("x", **throttle):
            passed["throttle"].append(second)
        if logger.info("x", skip_first=True, **throttle):
            passed["both"].append(second)
    assert passed == {"once": [0], "skip": [1, 2, 3, 4, 5], "throttle": [2, 4], "both": [4], "off": [0, 1, 2, 3, 4, 5]}


def test_each_place_has_its_own_filter_state() -> None:
    logger = get_logger("places")
    assert [logger.info("a", once=True), logger.info("a", once=True)] == [True, True]


def test_options_are_checked() -> None:
    logger = get_logger("options")
    with pytest.raises(TypeError, match='required parameter "throttle_duration_sec" not specified'):
        logger.info("x", throttle_time_source_type=ROSClock())
    with pytest.raises(TypeError, match='parameter "twice" is not one of the recognized logging options'):
        logger.info("x", twice=True)
    with pytest.raises(ValueError, match="is not a clock instance"):
        logger.info("x", throttle_duration_sec=1.0, throttle_time_source_type="steady")
    with pytest.raises(TypeError, match="a log message must be a str, got int"):
        logger.info(5)
    for changes, text in (
        ([{"throttle_duration_sec": 1.0}, {"throttle_duration_sec": 2.0}], "parameters cannot be changed"),
        ([{"once": True}, {"skip_first": True}], "filters cannot be changed"),
        ([{"name": "a"}, {"name": "b"}], "name cannot be changed"),
    ):
        with pytest.raises(ValueError, match=text):
            for change in changes:
                logger.info("x", **change)
    with pytest.raises(ValueError, match="severity cannot be changed"):
        for severity in (LoggingSeverity.INFO, LoggingSeverity.WARN):
            logger.log("x", severity)
    set_logger_level("options", LoggingSeverity.WARN)
    assert logger.info(5, nonsense=1) is False


def test_console_line(capfd: pytest.CaptureFixture[str]) -> None:
    logger = get_logger("some.node")
    logger.info("hello")
    assert logger.debug("not seen") is False
    captured = capfd.readouterr()
    assert captured.out == ""
    head, _, text = captured.err.rpartition("]: ")
    assert text == "hello\n"
    severity, stamp, name = head.lstrip("[").split("] [")
    assert (severity, name) == ("INFO", "some.node")
    seconds, _, nanoseconds = stamp.partition(".")
    assert len(seconds) == 10 and len(nanoseconds) == 9


@pytest.mark.parametrize(
    ("environment", "line"),
    [
        ({}, "[WARN] [1700000000.012345678] [a.b]: text {name}"),
        (
            {"RCUTILS_CONSOLE_OUTPUT_FORMAT": r"{severity}|{file_name}:{line_number}\t{function_name}()|{message}\n"},
            "WARN|/x/file.py:7\tfunc()|text {name}\n",
        ),
        (
            {"RCUTILS_CONSOLE_OUTPUT_FORMAT": r"{{name}} {unknown} {time_as_nanoseconds}\x1b"},
            "{a.b} {unknown} 1700000000012345678\x1b",
        ),
    ],
)
def test_console_layout(monkeypatch: pytest.MonkeyPatch, environment: dict[str, str], line: str) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert Console().format(RECORD) == line


def test_console_colour_and_stream(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("RCUTILS_COLORIZED_OUTPUT", "1")
    monkeypatch.setenv("RCUTILS_LOGGING_USE_STDOUT", "1")
    monkeypatch.setenv("RCUTILS_CONSOLE_OUTPUT_FORMAT", "{message}")
    Console()(RECORD)
    assert capfd.readouterr() == ("\x1b[33mtext {name}\x1b[0m\n", "")
    monkeypatch.setenv("RCUTILS_COLORIZED_OUTPUT", "maybe")
    Console()
    assert "unexpected value [maybe] specified for RCUTILS_COLORIZED_OUTPUT" in capfd.readouterr().err


@pytest.mark.parametrize("stream", [None, "closed"])
def test_a_console_that_is_gone_does_no_harm(monkeypatch: pytest.MonkeyPatch, stream: str | None) -> None:
    if stream == "closed":
        with open(os.devnull, "w") as closed:
            pass
        monkeypatch.setattr(sys, "stderr", closed)
    else:
        monkeypatch.setattr(sys, "stderr", None)
    assert get_logger("gone").error("nobody hears") is True


def test_command_line() -> None:
    system.configure(parse(["--ros-args", "--log-level", "error", "--log-level", "a:=debug", "--disable-stdout-logs"]))
    assert get_logger_effective_level("x") is LoggingSeverity.ERROR
    assert get_logger_effective_level("a.b") is LoggingSeverity.DEBUG
    assert (system.stdout_enabled, system.rosout_enabled) == (False, True)
    system.finish()
    assert (system.stdout_enabled, system.rosout_enabled) == (True, False)
    assert get_logger_effective_level("x") is LoggingSeverity.ERROR


def test_rosout_gets_the_node_and_its_children() -> None:
    system.configure(parse([]))
    messages = []
    system.attach("node", messages.append)
    logger = get_logger("node")
    line = inspect.currentframe().f_lineno + 1
    logger.info("one")
    child = logger.get_child("child")
    grandchild = child.get_child("x")
    child.warning("two")
    grandchild.warning("three")
    get_logger("node.other").error("of nobody")
    get_logger("stranger").error("of nobody")
    logger.error("of nobody", name="stranger")
    first = messages[0]
    assert (first.level, first.name, first.msg, first.line) == (20, "node", "one", line)
    assert (os.path.basename(first.file), first.function) == (
        os.path.basename(__file__),
        "test_rosout_gets_the_node_and_its_children",
    )
    assert first.stamp.sec > 10**9
    assert [message.name for message in messages] == ["node", "node.child", "node.child.x"]

    del child
    get_logger("node.child").info("of nobody")
    grandchild.info("four")
    system.detach("node", messages.append)
    logger.info("five")
    assert [message.msg for message in messages[3:]] == ["four"]


def test_rosout_can_be_switched_off_and_does_not_recurse() -> None:
    logger, messages = get_logger("loop"), []

    def publish(message: object) -> None:
        messages.append(message)
        logger.info("while publishing")
        raise RuntimeError("destroyed meanwhile")

    system.attach("loop", publish)
    try:
        system.configure(parse(["--ros-args", "--disable-rosout-logs"]))
        logger.info("not published")
        system.configure(parse([]))
        logger.info("published")
    finally:
        system.detach("loop", publish)
    assert [message.msg for message in messages] == ["published"]


def test_two_nodes_of_one_name_share_a_publisher(capfd: pytest.CaptureFixture[str]) -> None:
    system.configure(parse([]))
    one, two = [], []
    system.attach("twin", one.append)
    system.attach("twin", two.append)
    assert "Publisher already registered for node name: 'twin'" in capfd.readouterr().err
    logger = get_logger("twin")
    logger.info("a")
    system.detach("twin", one.append)
    logger.info("b")
    system.detach("twin", two.append)
    assert ([message.msg for message in one], [message.msg for message in two]) == (["a"], ["b"])


def test_after_the_last_context_a_name_is_free_again(capfd: pytest.CaptureFixture[str]) -> None:
    system.configure(parse([]))
    one, two = [], []
    system.attach("again", one.append)
    system.finish()
    system.configure(parse([]))
    system.attach("again", two.append)
    assert capfd.readouterr().err == ""
    system.detach("again", one.append)
    get_logger("again").info("a")
    system.detach("again", two.append)
    assert (one, [message.msg for message in two]) == ([], ["a"])


def test_log_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_LOG_DIR", "ROS_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/fake")
    assert str(get_logging_directory()) == "/fake/.ros/log"
    monkeypatch.setenv("ROS_HOME", "/ros")
    assert str(get_logging_directory()) == "/ros/log"
    monkeypatch.setenv("ROS_LOG_DIR", "~/logs")
    assert str(get_logging_directory()) == "/fake/logs"


def test_importing_the_state_of_a_node_builds_no_message_class() -> None:
    code = (
        "import sys, rclpy.logging, rclpy.arguments, rclpy.parameter_store, rclpy.clock, rclpy.qos, rclpy.time_source\n"
        "print([m for m in sys.modules if m in ('yaml', 'rosbags')])\n"
        "print([name for name in vars(sys.modules['rcl_interfaces.msg']) if name[0].isupper()])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=240, check=True)
    assert done.stdout.split() == ["[]", "[]"]
