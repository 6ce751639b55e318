"""The replayer: what it publishes reaches subscribers, from the first message on."""

import signal
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbag2_interfaces.srv import (
    Burst,
    GetRate,
    IsPaused,
    Pause,
    PlayNext,
    Resume,
    Seek,
    SetRate,
    Stop,
    TogglePaused,
)
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, String

from fsw_control.topics_ros import LATEST
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.replay_node import main
from fsw_test_support.bags import decoder

pytestmark = pytest.mark.slow

REPLAY = "fsw_recorder.replay_node"
CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class Listener:
    """Everything heard on topics of the genuine bags."""

    def __init__(self, graph: Any, prefix: str = "/demo") -> None:
        self.depths: list[float] = []
        self.latched: list[str] = []
        self.clock_ns: list[int] = []
        node = graph.node
        node.create_subscription(
            Float64, f"{prefix}/depth", lambda m: self.depths.append(m.data), 1000
        )
        node.create_subscription(
            String, f"{prefix}/latched", lambda m: self.latched.append(m.data), LATEST
        )
        node.create_subscription(
            Clock,
            "/clock",
            lambda m: self.clock_ns.append(m.clock.sec * 10**9 + m.clock.nanosec),
            CLOCK,
        )


def depths_of(bag: Path) -> list[float]:
    with BagReader(bag) as reader:
        return [message.data for message in map(decoder(reader), reader.records(["/demo/depth"]))]


@pytest.mark.parametrize("name", ["mcap_zstd", "sqlite3"])
def test_every_message_arrives_with_its_clock(graph: Any, genuine: Path, name: str) -> None:
    genuine_bag = genuine / name
    listener = Listener(graph)
    # else, on a busy machine, it begins before they are discovered
    wait = "wait_for:=[/demo/depth, /demo/latched]"
    player = graph.start(REPLAY, str(genuine_bag), "--ros-args", "-p", "rate:=10.0", "-p", wait)
    depths = depths_of(genuine_bag)
    graph.until(
        lambda: len(listener.depths) == len(depths) and listener.latched and listener.clock_ns
    )
    code, output = graph.end(player)
    assert code == 0 and "played 177 messages" in output
    assert listener.depths == depths and listener.latched == ["håll 816 °C"]
    assert listener.clock_ns == sorted(listener.clock_ns)
    with BagReader(genuine_bag) as reader:
        info = reader.info()
    assert info.start_ns <= listener.clock_ns[0] and listener.clock_ns[-1] <= info.end_ns


def test_control_while_paused(graph: Any, genuine: Path) -> None:
    bag = genuine / "mcap_split"
    depths = depths_of(bag)
    with BagReader(bag) as reader:
        info = reader.info()
    listener = Listener(graph)
    parameters = [
        "start_paused:=true",
        "topics:=[/demo/depth]",
        "wait_settle:=0.0",
        "wait_for:=[/demo/depth]",
    ]
    arguments = [
        word for parameter in [*parameters, "exit_at_end:=false"] for word in ("-p", parameter)
    ]
    player = graph.start(REPLAY, str(bag), "--ros-args", *arguments)
    assert graph.ask(IsPaused, "/fsw_replay/is_paused").paused
    graph.until(lambda: graph.ask(PlayNext, "/fsw_replay/play_next").success)
    assert graph.ask(Burst, "/fsw_replay/burst", num_messages=4).actually_burst == 4
    graph.until(lambda: len(listener.depths) == 5)
    assert listener.depths == depths[:5]

    last_second = info.end_ns - 1_000_000_000
    when = Time(sec=last_second // 10**9, nanosec=last_second % 10**9)
    assert graph.ask(Seek, "/fsw_replay/seek", time=when).success
    assert not graph.ask(Seek, "/fsw_replay/seek", time=Time(sec=1)).success
    assert graph.ask(SetRate, "/fsw_replay/set_rate", rate=5.0).success
    assert not graph.ask(SetRate, "/fsw_replay/set_rate", rate=-1.0).success
    assert graph.ask(GetRate, "/fsw_replay/get_rate").rate == 5.0
    graph.ask(Resume, "/fsw_replay/resume")
    assert not graph.ask(IsPaused, "/fsw_replay/is_paused").paused
    graph.until(lambda: listener.depths[-1] == depths[-1])
    rest = listener.depths[5:]
    assert 8 <= len(rest) <= 12 and rest == depths[-len(rest) :]

    start = Time(sec=info.start_ns // 10**9, nanosec=info.start_ns % 10**9)
    graph.ask(Pause, "/fsw_replay/pause")
    assert graph.ask(Seek, "/fsw_replay/seek", time=start).success
    assert graph.ask(Burst, "/fsw_replay/burst", num_messages=0).actually_burst == len(depths)
    graph.ask(TogglePaused, "/fsw_replay/toggle_paused")
    assert not graph.ask(IsPaused, "/fsw_replay/is_paused").paused
    graph.ask(Stop, "/fsw_replay/stop")
    assert graph.end(player, signal.SIGINT)[0] == 0


def test_offset_selection_remapping_and_loop(graph: Any, genuine: Path) -> None:
    listener = Listener(graph, "/past")
    remaps = ["-r", "/demo/depth:=/past/depth", "-r", "/demo/latched:=/past/latched"]
    parameters = ["start_offset:=4.0", "loop:=true", "rate:=4.0", "regex:=/demo/.*", "clock:=none"]
    arguments = remaps + [word for parameter in parameters for word in ("-p", parameter)]
    player = graph.start(REPLAY, str(genuine / "mcap_zstd"), "--ros-args", *arguments)
    depths = depths_of(genuine / "mcap_zstd")
    graph.until(lambda: listener.depths.count(depths[-1]) >= 2 and listener.latched)
    assert graph.end(player, signal.SIGTERM)[0] == 0
    assert listener.latched[0] == "håll 816 °C"
    part = listener.depths[: listener.depths.index(depths[-1]) + 1]
    assert part == depths[-len(part) :] and listener.depths.count(depths[-1]) >= 2
    assert listener.clock_ns == []


def test_waiting_for_what_is_not_played_ends_the_start(graph: Any, genuine: Path) -> None:
    wait = "wait_for:=[/demo/depth, /demo/no_such]"
    player = graph.start(REPLAY, str(genuine / "sqlite3"), "--ros-args", "-p", wait)
    code, output = graph.end(player)
    assert code == 2 and "/demo/no_such" in output


def test_a_bag_that_is_missing_ends_the_start_with_one_line(graph: Any, tmp_path: Path) -> None:
    code, output = graph.end(graph.start(REPLAY, "missing", cwd=tmp_path))
    assert code == 2 and "no such bag" in output and output.count("\n") == 1


@pytest.mark.usefixtures("domain_id")
@pytest.mark.parametrize(
    ("arguments", "text"),
    [([], "no bag given"), (["{bag}", "--ros-args", "-p", "clock:=recorded"], "no /clock")],
)
def test_bad_arguments_are_one_line(
    genuine: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], text: str
) -> None:
    assert (
        main(["replay", *(word.format(bag=genuine / "mcap_default") for word in arguments)]) == 2
    )
    printed = "".join(capfd.readouterr())
    assert text in printed and printed.count("\n") == 1
