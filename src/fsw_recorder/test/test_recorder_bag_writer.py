"""Written bags are rosbag2 bags, and failures leave them readable."""

import errno
import gc
import os
import shutil
import struct
import tempfile
import threading
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from fsw_recorder import BagError
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter, RecordedTopic, WriterOptions
from fsw_recorder.manifest import MANIFEST_NAME
from fsw_recorder.topic import profile

HASH = "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a"
TOPIC = RecordedTopic("/x", "std_msgs/msg/Float64", "float64 data\n", HASH)
START_NS = 1_700_000_000_000_000_000


def cdr(value: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<d", value)


def fill(writer: BagWriter, count: int, first: int = 0, in_chunk: int = 10_000) -> None:
    writer.add_topic(TOPIC)
    for index in range(first, first + count):
        time_ns = START_NS + index * 1_000_000
        assert writer.write("/x", cdr(index), time_ns, time_ns - 7, index)
        if index % in_chunk == in_chunk - 1:
            assert writer.flush()


def values_of(bag: Path) -> list[float]:
    with BagReader(bag) as reader:
        return [struct.unpack("<d", record.data[4:])[0] for record in reader.records()]


def test_the_index_of_a_file_leaves_memory_with_the_file(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        fill(writer, 50, in_chunk=1)
        writer.split()
        assert writer.flush()
        gc.collect()
        assert sum(isinstance(item, ChunkIndex) for item in gc.get_objects()) == 0
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and len(summary.chunk_indexes) == 50


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_other_tools_read_it(tmp_path: Path, compression: str) -> None:
    bag = tmp_path / "bag"
    latched = RecordedTopic(
        "/latched", "std_msgs/msg/String", "string data\n", qos=(profile(latched=True, depth=1),)
    )
    with BagWriter(
        bag, WriterOptions(compression=compression), {"who": 'me: "x" \\ #1'}
    ) as writer:
        writer.add_topic(latched)
        writer.write("/latched", b"\0\1\0\0\3\0\0\0hi\0", START_NS, START_NS)
        fill(writer, 100, in_chunk=15)
        writer.attach("scenario.yaml", "application/yaml", b"a: 1\n")
    with Reader(bag) as reader:
        assert reader.message_count == 101
        assert {c.topic: (c.msgtype, c.msgcount) for c in reader.connections} == {
            "/x": ("std_msgs/msg/Float64", 100),
            "/latched": ("std_msgs/msg/String", 1),
        }
        assert len(list(reader.messages())) == 101
        assert reader.start_time == START_NS and reader.duration == 99_000_000 + 1
    with AnyReader([bag]) as any_reader:
        decoded = [
            any_reader.deserialize(data, c.msgtype)
            for c, _, data in any_reader.messages()
            if c.topic == "/x"
        ]
    assert [message.data for message in decoded] == list(range(100))  # type: ignore[attr-defined]
    with (bag / "bag_0.mcap").open("rb") as stream:
        mcap = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        messages = list(mcap.iter_decoded_messages(topics=["/x"]))
        assert [decoded.data for _, _, _, decoded in messages] == list(range(100))
        assert [(m.log_time, m.publish_time, m.sequence) for _, _, m, _ in messages][1] == (
            START_NS + 1_000_000,
            START_NS + 1_000_000 - 7,
            1,
        )
        assert [(attachment.name, attachment.data) for attachment in mcap.iter_attachments()] == [
            ("scenario.yaml", b"a: 1\n")
        ]
        assert mcap.get_header().profile == "ros2"
        summary = mcap.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == 101
    with (bag / "bag_0.mcap").open("rb") as stream:
        assert list(StreamReader(stream, validate_crcs=True).records)


def test_looks_like_a_genuine_bag(tmp_path: Path, genuine: Path) -> None:
    """A genuine bag, copied message by message, gets the same metadata, channels and schemas."""
    source = genuine / "mcap_default"
    bag = tmp_path / "mcap_default"
    with BagReader(source) as reader, BagWriter(bag) as writer:
        for topic in reader.topics().values():
            writer.add_topic(topic)
        for record in reader.records():
            writer.write(
                record.topic,
                record.data,
                record.log_time_ns,
                record.publish_time_ns,
                record.sequence,
            )

    def facts(folder: Path) -> Any:
        document = yaml.safe_load((folder / "metadata.yaml").read_text())
        document["rosbag2_bagfile_information"]["topics_with_message_count"].sort(
            key=lambda topic: topic["topic_metadata"]["name"]
        )
        with (folder / "mcap_default_0.mcap").open("rb") as stream:
            summary = make_reader(stream).get_summary()
            assert summary is not None
            channels = {
                channel.topic: (
                    channel.message_encoding,
                    channel.metadata,
                    summary.schemas[channel.schema_id],
                )
                for channel in summary.channels.values()
            }
        return document, {
            topic: (encoding, metadata, schema.name, schema.encoding, schema.data)
            for topic, (encoding, metadata, schema) in channels.items()
        }

    assert facts(bag) == facts(source)
    with (bag / "mcap_default_0.mcap").open("rb") as stream:
        metadata = [
            one.metadata["serialized_metadata"] for one in make_reader(stream).iter_metadata()
        ][-1]
    inner = yaml.safe_load(metadata)
    assert (
        inner == yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    )


def test_split_by_size_duration_and_request(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "size", WriterOptions(max_bag_size=5000)) as writer:
        fill(writer, 1000, in_chunk=10)
    with BagWriter(tmp_path / "time", WriterOptions(max_bag_duration=0.1)) as writer:
        fill(writer, 1000)
    with BagWriter(tmp_path / "asked") as writer:
        fill(writer, 10)
        writer.split()
        fill(writer, 10, first=10)
        writer.split()
        writer.split()
    for name, least in (("size", 3), ("time", 9), ("asked", 2)):
        bag = tmp_path / name
        files = sorted(bag.glob("*.mcap"))
        assert len(files) >= least
        count = 20 if name == "asked" else 1000
        assert values_of(bag) == list(range(count))
        with Reader(bag) as reader:
            assert reader.message_count == count == len(list(reader.messages()))
        document = yaml.safe_load((bag / "metadata.yaml").read_text())[
            "rosbag2_bagfile_information"
        ]
        assert sum(file["message_count"] for file in document["files"]) == count
        assert [file["path"] for file in document["files"]] == document["relative_file_paths"]
    assert len(list((tmp_path / "asked").glob("*.mcap"))) == 2


def test_pause_and_resume(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        fill(writer, 5)
        writer.is_paused = True
        assert not writer.write("/x", cdr(-1.0), START_NS, START_NS)
        writer.is_paused = False
        fill(writer, 5, first=5)
    assert values_of(tmp_path / "bag") == list(range(10))
    assert writer.statistics()["dropped"] == 0


def test_empty_bag_is_a_bag(tmp_path: Path) -> None:
    BagWriter(tmp_path / "bag").close()
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 0
    with BagReader(tmp_path / "bag") as own:
        assert own.info().message_count == 0 and own.problems == []


def test_existing_folder_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "precious.mcap").write_bytes(b"data")
    with pytest.raises(BagError, match="exists already"):
        BagWriter(tmp_path / "bag")
    assert (tmp_path / "bag" / "precious.mcap").read_bytes() == b"data"


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be made"):
        BagWriter(tmp_path / "file" / "bag")
    with pytest.raises(BagError, match="cannot be made"):
        BagWriter(Path("/proc/bag"))


class FullDisk:
    """Stands for ``os.write`` on a disk with little room.

    What does not fit is written in part, as on a real one.
    """

    def __init__(self, room: int) -> None:
        self.room = room
        self._write = os.write

    def __call__(self, descriptor: int, data: Any) -> int:
        if self.room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = self._write(descriptor, bytes(data)[: self.room])
        self.room -= written
        return written


def fail_while_writing(
    bag: Path, options: WriterOptions, count: int = 3000, in_chunk: int = 50
) -> BagWriter:
    writer = BagWriter(bag, options)
    writer.add_topic(TOPIC)
    for index in range(count):
        writer.write("/x", cdr(index), START_NS + index, START_NS + index)
        if index % in_chunk == 0:
            writer.flush()
    assert not writer.flush() and writer.error is not None
    assert not writer.write("/x", cdr(0.0), START_NS, START_NS)
    writer.close()
    return writer


@pytest.mark.requirement("S24")
@pytest.mark.slow
@pytest.mark.parametrize("room", [700, 5_003, 20_011, 40_000])
@pytest.mark.parametrize("compression", ["", "zstd"])
def test_full_disk_leaves_a_readable_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int, compression: str
) -> None:
    monkeypatch.setattr("fsw_recorder.bag_file.os.write", FullDisk(room))
    bag = tmp_path / "bag"
    writer = fail_while_writing(bag, WriterOptions(compression=compression))
    monkeypatch.undo()
    assert "No space left" in str(writer.error) and str(bag) in str(writer.error)
    values = values_of(bag)
    assert values == list(range(len(values)))
    counters = writer.statistics()
    assert counters["written"] == len(values)
    assert counters["received"] == counters["written"] + counters["dropped"]


def test_disk_with_room_for_the_end_gets_a_finished_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The failed chunk is larger than the summary, so that there is room for the latter."""
    disk = FullDisk(70_000)
    monkeypatch.setattr("fsw_recorder.bag_file.os.write", disk)
    original = os.ftruncate

    def truncate(descriptor: int, size: int) -> None:
        disk.room += os.fstat(descriptor).st_size - size
        original(descriptor, size)

    monkeypatch.setattr("fsw_recorder.bag_file.os.ftruncate", truncate)
    fail_while_writing(tmp_path / "bag", WriterOptions(chunk_period=100.0), 5000, in_chunk=500)
    monkeypatch.undo()
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == len(list(reader.messages())) > 500


@pytest.mark.requirement("S24")
def test_full_disk_has_room_for_what_closes_a_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reserves: list[Any] = []
    original = os.open

    def reserve(**arguments: Any) -> Any:
        reserves.append(temporary_file(**arguments))
        return reserves[-1]

    def open_new(name: Any, *arguments: Any, **options: Any) -> int:
        if str(name).endswith(".new") and not reserves[0].closed:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(name, *arguments, **options)

    temporary_file = tempfile.TemporaryFile
    monkeypatch.setattr("fsw_recorder.bag_writer.tempfile.TemporaryFile", reserve)
    monkeypatch.setattr("fsw_recorder.bag_writer.os.open", open_new)
    monkeypatch.setattr("fsw_recorder.bag_file.os.write", FullDisk(20_000))
    fail_while_writing(tmp_path / "bag", WriterOptions(manifest=True))
    names = {file.name for file in (tmp_path / "bag").iterdir()}
    assert names == {"bag_0.mcap", METADATA_NAME, MANIFEST_NAME}


@pytest.mark.requirement("S24")
def test_vanished_folder_is_reported(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    writer = BagWriter(bag)
    fill(writer, 10)
    assert writer.flush()
    shutil.rmtree(bag)
    writer.write("/x", cdr(10.0), START_NS, START_NS)
    assert not writer.flush()
    writer.close()
    assert "moved or deleted" in str(writer.error)
    assert not bag.exists()


def test_moved_folder_holds_a_finished_bag(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    writer = BagWriter(bag)
    fill(writer, 10)
    assert writer.flush()
    bag.rename(tmp_path / "moved")
    writer.write("/x", cdr(10.0), START_NS + 10**9, START_NS)
    assert not writer.flush()
    writer.close()
    with Reader(tmp_path / "moved") as reader:
        assert reader.message_count == len(list(reader.messages())) >= 10


@pytest.mark.requirement("S24")
def test_slow_disk_never_blocks_and_drops_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    release = threading.Event()
    original = os.write

    def stuck(descriptor: int, data: Any) -> int:
        release.wait(20.0)
        return original(descriptor, data)

    writer = BagWriter(tmp_path / "bag", WriterOptions(max_cache_size=1200))
    writer.add_topic(TOPIC)
    monkeypatch.setattr("fsw_recorder.bag_file.os.write", stuck)
    taken = [writer.write("/x", cdr(index), START_NS + index, START_NS) for index in range(1000)]
    assert taken[0] and not taken[-1]
    release.set()
    writer.close()
    assert values_of(tmp_path / "bag") == [index for index, ok in enumerate(taken) if ok]
    assert writer.statistics()["dropped"] == taken.count(False)


def test_a_publish_time_that_no_file_can_hold_is_replaced(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        fill(writer, 3)
        for publish_ns in (-1, 2**64):
            assert writer.write("/x", cdr(9.0), START_NS + 10**9, publish_ns)
        assert not writer.write("/x", cdr(9.0), -1, START_NS)
    assert writer.error is None and writer.statistics()["dropped"] == 1
    with BagReader(tmp_path / "bag") as reader:
        assert [record.publish_time_ns for record in reader.records()][-2:] == [
            START_NS + 10**9
        ] * 2


def test_write_failure_is_reported_and_leaves_an_intact_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = BagWriter(tmp_path / "bag")
    fill(writer, 10)
    assert writer.flush()

    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("unexpected")

    monkeypatch.setattr("mcap.writer.Writer.add_message", broken)
    writer.write("/x", cdr(10.0), START_NS + 10**9, START_NS)
    assert not writer.flush()
    monkeypatch.undo()
    assert not writer.write("/x", cdr(11.0), START_NS + 10**9, START_NS)
    writer.close()
    assert "RuntimeError: unexpected" in str(writer.error)
    assert writer.statistics()["written"] == 10 and writer.statistics()["dropped"] == 2
    with Reader(tmp_path / "bag") as reader:
        assert len(list(reader.messages())) == 10


def test_closing_twice_is_harmless_and_later_messages_are_refused(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag")
    fill(writer, 3)
    writer.close()
    writer.close()
    assert not writer.write("/x", cdr(4.0), START_NS, START_NS)
    assert values_of(tmp_path / "bag") == [0, 1, 2]


def test_topic_without_description(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.write("/strange", cdr(1.0), START_NS, START_NS)
    assert values_of(tmp_path / "bag") == [1.0]


def test_topic_keeps_its_first_description(tmp_path: Path) -> None:
    """Readers match channels with the metadata by QoS.

    A change on the way would hide messages from them.
    """
    with BagWriter(tmp_path / "bag") as writer:
        fill(writer, 5)
        assert writer.flush()
        writer.add_topic(
            RecordedTopic(
                "/x", "std_msgs/msg/Float64", "float64 data\n", HASH, (profile(depth=3),)
            )
        )
        for index in range(5, 8):
            writer.write("/x", cdr(index), START_NS + index * 10**6, START_NS)
    with Reader(tmp_path / "bag") as reader:
        assert len(list(reader.messages())) == 8 and len(reader.connections) == 1


def test_failed_flush_is_reported_to_waiters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = threading.Event()

    def full(*_: object) -> int:
        disk.wait(60.0)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    writer = BagWriter(tmp_path / "bag")
    writer.add_topic(TOPIC)
    monkeypatch.setattr("fsw_recorder.bag_file.os.write", full)
    writer.write("/x", cdr(0.0), START_NS, START_NS)
    flushes = [writer.flushed(), writer.flushed()]
    disk.set()
    writer.close()
    flushes.append(writer.flushed())
    assert [flush.result(0.0) for flush in flushes] == [
        False,
        False,
        False,
    ] and writer.error is not None
