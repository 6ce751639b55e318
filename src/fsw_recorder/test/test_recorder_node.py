"""The recorder among real topics, as a process of its own."""

import errno
import os
import resource
import signal
import threading
import time
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbag2_interfaces.srv import IsPaused, Pause, Resume, SplitBagfile
from rosbags.rosbag2 import Reader
from std_msgs.msg import String

from fsw_control.topics_ros import LATEST
from fsw_msgs.msg import ShoulderDepth
from fsw_recorder.bag_file import BagFile
from fsw_recorder.bag_reader import BagReader, BagRecord
from fsw_recorder.errors import BagError
from fsw_recorder.recorder_node import RecorderNode, main, reported_state
from fsw_recorder.recording import Note
from fsw_recorder.topic import is_latched, is_reliable
from fsw_test_support.bags import decoder
from fsw_test_support.waiting import PATIENCE_S

pytestmark = pytest.mark.slow

RECORDER = "fsw_recorder.recorder_node"
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


def start_recorder(graph: Any, bag: Path, *parameters: str, **options: Any) -> Any:
    arguments = [
        word for parameter in (f"output:={bag}", *parameters) for word in ("-p", parameter)
    ]
    return graph.start(RECORDER, "--ros-args", *arguments, **options)


def talk(graph: Any, publisher: Any, number: int, first: int = 0) -> None:
    graph.until(lambda: publisher.get_subscription_count() > 0)
    for index in range(first, first + number):
        publisher.publish(ShoulderDepth(depth=float(index)))
        if index % 50 == 0:
            graph.until(lambda: True)


def until_recorded(graph: Any, bag: Path, depths: int, topic: str = "/fsw/depth") -> None:
    """Until so many messages are on file; there may be no file yet, or an empty one.

    Read when it has grown.
    """
    sizes: list[int] = []

    def recorded() -> bool:
        before = sizes[:]
        sizes[:] = [
            path.stat().st_size for path in (bag, *sorted(bag.glob("*"))) if path.is_file()
        ]
        try:
            return sizes != before and len(depths_of(bag, topic)) >= depths
        except (BagError, KeyError):
            return False

    graph.until(recorded, f"{depths} messages of {topic}")


def records_of(bag: Path, topic: str) -> list[BagRecord]:
    with BagReader(bag) as reader:
        return list(reader.records([topic]))


def depths_of(bag: Path, topic: str = "/fsw/depth") -> list[float]:
    with BagReader(bag) as reader:
        return [message.depth for message in map(decoder(reader), reader.records([topic]))]


def test_everything_is_recorded_and_the_file_is_whole(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    scenario = tmp_path / "my scenario.yaml"
    scenario.write_text("name: test\n")
    latched = graph.node.create_publisher(String, "/latched", LATEST)
    latched.publish(String(data="early"))
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1000)
    unreliable = graph.node.create_publisher(ShoulderDepth, "/unreliable", BEST_EFFORT)
    graph.node.declare_parameter("gain", 2.5)
    recorder = start_recorder(graph, bag, f"scenario:={scenario}", "custom_data:=[operator=me]")
    talk(graph, depth, 500)
    graph.until(lambda: latched.get_subscription_count() and unreliable.get_subscription_count())
    until_recorded(graph, bag, 500)  # with nothing else on the way, nothing unreliable is lost
    talk(graph, unreliable, 5)
    new = graph.node.create_publisher(ShoulderDepth, "/new/topic", 10)
    talk(graph, new, 7)
    graph.until(lambda: b"gain" in (bag / "bag_0.mcap").read_bytes())
    for number, topic in ((5, "/unreliable"), (7, "/new/topic")):
        until_recorded(graph, bag, number, topic)
    code, output = graph.end(recorder, signal.SIGINT)
    assert code == 0, output
    assert depths_of(bag) == list(range(500))
    assert (
        depths_of(bag, "/new/topic") == list(range(7)) and len(depths_of(bag, "/unreliable")) == 5
    )
    (early,) = records_of(bag, "/latched")
    assert b"early\0" in early.data
    for record in records_of(bag, "/fsw/depth"):
        assert 0 <= record.log_time_ns - record.publish_time_ns < PATIENCE_S * 1e9
    with BagReader(bag) as reader:
        info, topics = reader.info(), reader.topics()
        attachments = {attachment.name: attachment.data for attachment in reader.attachments()}
    assert (
        reader.problems == []
        and reader.metadata.custom_data["operator"] == "me"
        and reader.metadata.custom_data["lost_messages"] == "0"
    )
    assert attachments["scenario.yaml"] == b"name: test\n"
    assert (
        b"gain: 2.5" in attachments["parameters/test_node.yaml"]
        and b"python" in attachments["versions.json"]
    )
    assert (
        topics["/fsw/depth"].type_hash.startswith("RIHS01_")
        and "float64 depth" in topics["/fsw/depth"].definition
    )
    assert is_latched(topics["/latched"].qos[0])
    assert not is_reliable(topics["/unreliable"].qos[0])
    with Reader(bag) as reader:
        assert reader.message_count == info.message_count == len(list(reader.messages()))


def test_nothing_is_recorded_before_the_awaited_topics_are_there(
    graph: Any, tmp_path: Path
) -> None:
    """So that a plant that waits for subscribers waits for a recorder that has found all nodes."""
    bag = tmp_path / "bag"
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1000)
    recorder = start_recorder(
        graph, bag, 'wait_for_topics:=["fsw/late", "fsw/later"]', "discovery_period:=0.05"
    )
    late = graph.node.create_publisher(String, "/fsw/late", 10)
    graph.until(
        lambda: late.get_subscription_count() == 1, "the first awaited topic is recorded at once"
    )
    reports: list[DiagnosticArray] = []
    graph.node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, 10)
    graph.until(lambda: len(reports) >= 2, "reports, between which the recorder has looked again")
    assert depth.get_subscription_count() == 0
    graph.node.create_publisher(String, "/fsw/later", 10)
    talk(graph, depth, 3)
    until_recorded(graph, bag, 3)
    assert graph.end(recorder, signal.SIGINT)[0] == 0
    assert depths_of(bag) == [0.0, 1.0, 2.0]


def test_weaker_publisher_that_comes_later_is_heard(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    reliable = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1000)
    latched = graph.node.create_publisher(String, "/latched", LATEST)
    latched.publish(String(data="early"))
    recorder = start_recorder(graph, bag)
    talk(graph, reliable, 100)
    graph.until(lambda: latched.get_subscription_count() > 0)
    weaker = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", BEST_EFFORT)
    volatile = graph.node.create_publisher(String, "/latched", 10)
    graph.until(
        lambda: weaker.get_subscription_count() > 0 and volatile.get_subscription_count() > 0
    )
    graph.until(
        lambda: reliable.get_subscription_count() == 2 and latched.get_subscription_count() == 2
    )
    for index in range(100, 200):
        (weaker if index % 2 else reliable).publish(ShoulderDepth(depth=float(index)))
        graph.until(lambda: True)
    volatile.publish(String(data="late"))
    latched.publish(String(data="later"))
    graph.until(lambda: b"later" in (bag / "bag_0.mcap").read_bytes())
    best_effort = set(range(101, 200, 2))  # a busy machine may lose some of these
    reliable_ones = (
        set(range(200)) - best_effort
    )  # there is no order between topics: "later" may come first
    graph.until(lambda: reliable_ones <= set(depths_of(bag)))
    code, output = graph.end(recorder, signal.SIGTERM)
    assert code == 0 and "/fsw/depth again" in output
    heard = depths_of(bag)
    assert len(heard) == len(set(heard)) and set(heard) | best_effort == set(range(200))
    came = best_effort & set(heard)
    assert came
    assert len(records_of(bag, "/latched")) == 3
    with BagReader(bag) as reader:
        lost = int(reader.metadata.custom_data["lost_messages"])
    assert (lost > 0) == any(
        number < max(came) for number in best_effort - came
    )  # known by what comes after it


@pytest.mark.parametrize(
    ("state", "level", "note"),
    [
        ((False, False, [], None), DiagnosticStatus.OK, Note.RECORDING),
        ((True, False, [], None), DiagnosticStatus.WARN, Note.INCOMPLETE),
        ((False, True, [], None), DiagnosticStatus.OK, Note.PAUSED),
        ((True, True, [], None), DiagnosticStatus.WARN, Note.PAUSED),
        ((True, True, ["/fsw/late"], None), DiagnosticStatus.WARN, Note.AWAITED),
        ((True, True, ["/fsw/late"], "disk full"), DiagnosticStatus.ERROR, Note.FAILED),
    ],
)
def test_report_says_first_what_keeps_a_recorder_from_writing(
    state: Any, level: bytes, note: Note
) -> None:
    reported, fact = reported_state(*state)
    assert (reported, fact.code) == (level, note)


def test_services(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1000)
    recorder = start_recorder(graph, bag, "topics:=[/fsw/depth]", "start_paused:=true")
    graph.until(lambda: depth.get_subscription_count() > 0)
    assert graph.ask(IsPaused, "/fsw_recorder/is_paused").paused
    graph.ask(Resume, "/fsw_recorder/resume")
    talk(graph, depth, 10)
    until_recorded(graph, bag / "bag_0.mcap", 10)
    graph.ask(SplitBagfile, "/fsw_recorder/split_bagfile")
    talk(graph, depth, 10, first=10)
    until_recorded(graph, bag, 20)
    graph.ask(Pause, "/fsw_recorder/pause")
    assert graph.ask(IsPaused, "/fsw_recorder/is_paused").paused
    talk(graph, depth, 10, first=100)
    assert graph.end(recorder, signal.SIGTERM)[0] == 0
    assert depths_of(bag) == list(range(20))
    assert depths_of(bag / "bag_0.mcap") == list(range(10))


def test_messages_are_received_while_a_flush_is_slow(
    graph: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = tmp_path / "bag"
    disk, commit = threading.Event(), BagFile.commit
    disk.set()

    def slow_commit(file: BagFile) -> None:
        disk.wait(60.0)
        commit(file)

    monkeypatch.setattr(BagFile, "commit", slow_commit)
    values = {"output": str(bag), "topics": ["/fsw/depth"], "queue_depth": 1}
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    recorder = RecorderNode(context=graph.context, parameter_overrides=overrides)
    graph.executor.add_node(recorder)

    def record(first: int, end: int) -> None:
        for number in range(first, end):
            depth.publish(ShoulderDepth(depth=float(number)))
            graph.until(lambda: recorder.writer.statistics()["received"] == number + 1)  # noqa: B023

    try:
        depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1)
        graph.until(lambda: depth.get_subscription_count() > 0)
        record(0, 5)
        client = graph.node.create_client(SplitBagfile, "/fsw_recorder/split_bagfile")
        graph.until(client.service_is_ready)
        disk.clear()
        answer = client.call_async(SplitBagfile.Request())
        record(5, 50)
        assert not answer.done(), "the answer did not wait for the disk"
        disk.set()
        graph.until(answer.done)
    finally:
        disk.set()
        graph.executor.remove_node(recorder)
        recorder.destroy_node()
    assert depths_of(bag) == list(range(50))


def test_each_message_of_a_flood_is_recorded_or_counted_as_lost(
    graph: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some are overwritten in the queue before the recorder looks, some do not fit into the memory for a slow disk."""
    disk, commit, sent = threading.Event(), BagFile.commit, 0
    disk.set()

    def slow_commit(file: BagFile) -> None:
        disk.wait(60.0)
        commit(file)

    monkeypatch.setattr(BagFile, "commit", slow_commit)
    values = {
        "output": str(tmp_path / "bag"),
        "topics": ["/flood"],
        "queue_depth": 100,
        "max_cache_size": 2**20,
    }
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    recorder = RecorderNode(context=graph.context, parameter_overrides=overrides)
    graph.executor.add_node(recorder)
    try:
        flood = graph.node.create_publisher(String, "/flood", 1000)
        graph.until(lambda: flood.get_subscription_count() > 0)
        subscription = recorder.subscriptions_by_topic["/flood"]
        for burst in (1, 300, 300):
            for _ in range(burst):
                flood.publish(String(data="x" * 20_000))
            sent += burst
            graph.until(
                lambda sent=sent: (
                    recorder.writer.statistics()["received"] + subscription.lost == sent
                )
            )
            disk.clear()
        assert subscription.lost
        assert recorder.writer.statistics()["dropped"]
    finally:
        disk.set()
        graph.executor.remove_node(recorder)
        recorder.destroy_node()
    with BagReader(tmp_path / "bag") as reader:
        info = reader.info()
    assert info.message_count + int(reader.metadata.custom_data["lost_messages"]) == sent


def test_second_recorder_on_a_folder_is_refused(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1000)
    recorders = [start_recorder(graph, bag) for _ in range(2)]
    graph.until(lambda: any(process.poll() is not None for process in recorders))
    refused, recorder = sorted(recorders, key=lambda process: process.poll() is None)
    code, output = graph.end(refused)
    assert code == 2 and "exists already" in output and output.count("\n") == 1
    talk(graph, depth, 10)
    until_recorded(graph, bag, 10)
    assert graph.end(recorder, signal.SIGTERM)[0] == 0
    assert depths_of(bag) == list(range(10))


@pytest.mark.requirement("S22")
def test_kill_minus_nine_loses_at_most_a_second(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1000)
    recorder = start_recorder(graph, bag)
    graph.until(lambda: depth.get_subscription_count() > 0)
    sent: list[int] = []
    by_size: dict[int, int] = {}  #: messages on file by its size

    def send() -> None:
        depth.publish(ShoulderDepth(depth=float(len(sent))))
        sent.append(time.time_ns())

    def lost_now() -> int:
        """Messages of more than a second ago that would be lost.

        Where the machine stands still, there may be some.
        """
        now = time.time_ns()  # before the file, which grows while it is read
        file = bag / "bag_0.mcap"
        size = file.stat().st_size if file.exists() else 0
        if size not in by_size:
            try:
                by_size[size] = len(depths_of(bag))
            except BagError:  # an empty file, or none
                by_size[size] = 0
        return sum(stamp < now - 1_000_000_000 for stamp in sent[by_size[size] :])

    timer = graph.node.create_timer(0.01, send)
    graph.until(lambda: len(sent) >= 200)
    end_s = time.monotonic() + PATIENCE_S
    whole_s = time.monotonic()
    while (
        time.monotonic() < whole_s + 1.2
    ):  # longer than just after it has written: so whenever it is killed
        graph.spin()
        assert time.monotonic() < end_s, (
            "more than the last second is not on file, again and again"
        )
        if lost_now():
            whole_s = time.monotonic()
    on_file = len(depths_of(bag))
    recorder.kill()
    graph.node.destroy_timer(timer)
    assert graph.end(recorder)[0] == -signal.SIGKILL
    seen = depths_of(bag)
    assert seen == list(range(len(seen))) and len(seen) >= on_file


@pytest.mark.requirement("S24")
def test_full_disk_ends_the_recorder_and_nothing_else(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1000)
    reports: list[str] = []

    def note(message: DiagnosticArray) -> None:
        reports.extend(status.message for status in message.status)

    graph.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
    logged: list[str] = []
    graph.node.create_subscription(Log, "/rosout", lambda line: logged.append(line.msg), 100)
    recorder = start_recorder(
        graph, bag, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
    )
    graph.until(lambda: depth.get_subscription_count() > 0 and reports)
    timer = graph.node.create_timer(0.001, lambda: depth.publish(ShoulderDepth(depth=1.0)))
    graph.until(lambda: recorder.poll() is not None)
    graph.node.destroy_timer(timer)
    code, output = graph.end(recorder)
    assert code == 1 and output.count(f"writing failed: {os.strerror(errno.EFBIG)}") == 1
    graph.until(lambda: any("writing failed" in report for report in reports))
    graph.until(lambda: any("writing failed" in line for line in logged))
    with BagReader(bag) as reader:
        assert len(list(reader.records(["/fsw/depth"]))) > 100


@pytest.mark.requirement("S24")
def test_deleted_folder_is_reported(graph: Any, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 10)
    recorder = start_recorder(graph, bag)
    talk(graph, depth, 10)
    graph.until((bag / "bag_0.mcap").exists)
    (bag / "bag_0.mcap").unlink()
    timer = graph.node.create_timer(0.01, lambda: depth.publish(ShoulderDepth(depth=1.0)))
    graph.until(lambda: recorder.poll() is not None)
    graph.node.destroy_timer(timer)
    code, output = graph.end(recorder)
    assert code == 1 and "moved or deleted" in output


def test_a_bag_that_exists_ends_the_start_with_one_line(graph: Any, tmp_path: Path) -> None:
    (tmp_path / "existing").mkdir()
    code, output = graph.end(
        graph.start(RECORDER, "--ros-args", "-p", "output:=existing", cwd=tmp_path)
    )
    assert code == 2 and "exists already" in output and output.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["existing"]


@pytest.mark.usefixtures("domain_id")
@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        (["output:=b", "scenario:=missing.yaml"], "missing.yaml"),
        (["output:=c", "chunk_period:=7.0"], "chunk_period"),
    ],
)
def test_bad_parameters_are_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    parameters: list[str],
    text: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        main(
            [
                "recorder",
                "--ros-args",
                *(word for parameter in parameters for word in ("-p", parameter)),
            ]
        )
        == 2
    )
    printed = "".join(capfd.readouterr())
    assert text in printed and printed.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.requirement("S22")
@pytest.mark.full
def test_killed_recorder_continues_in_a_sibling_bag(graph: Any, tmp_path: Path) -> None:
    bag, sibling = tmp_path / "weld", tmp_path / "weld_1"
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 1000)
    first = start_recorder(graph, bag, "number_if_taken:=true")
    talk(graph, depth, 100)
    until_recorded(graph, bag, 100)
    first.kill()
    first.wait()
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    second = start_recorder(graph, bag, "number_if_taken:=true")
    numbers = count(100)  # the killed one counts as a subscriber until its lease ends
    timer = graph.node.create_timer(
        0.01, lambda: depth.publish(ShoulderDepth(depth=float(next(numbers))))
    )
    until_recorded(graph, sibling, 50)
    graph.node.destroy_timer(timer)
    code, output = graph.end(second, signal.SIGINT)
    assert code == 0 and "weld exists already" in output and "weld_1" in output
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before
    seen = depths_of(sibling)
    assert depths_of(bag) == list(range(100))
    assert seen == list(range(int(seen[0]), int(seen[0]) + len(seen))) and seen[0] >= 100
    with BagReader(sibling) as reader:
        assert reader.metadata.custom_data["continues"] == "weld"
