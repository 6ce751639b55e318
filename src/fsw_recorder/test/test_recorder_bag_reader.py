"""Bags recorded by genuine ROS 2, and bags in any state, are read."""

import os
import re
import shutil
import sqlite3
import struct
from pathlib import Path
from random import Random

import pytest
import zstandard
from mcap.reader import make_reader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from fsw_recorder import BagError
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter
from fsw_recorder.definitions import Definitions
from fsw_recorder.rosbags_file import decompressed
from fsw_recorder.topic import RecordedTopic, is_latched
from fsw_test_support.bags import decode, decoder


def test_genuine_bags_match_ros2_bag_info(genuine_bag: Path) -> None:
    text = (genuine_bag / "ros2_bag_info.txt").read_text()
    counts = {
        name: int(n) for name, n in re.findall(r"Topic: (\S+) \| Type: \S+ \| Count: (\d+)", text)
    }
    types = dict(re.findall(r"Topic: (\S+) \| Type: (\S+)", text))
    duration = re.search(r"Duration: +([\d.]+)s", text)
    assert duration is not None
    with BagReader(genuine_bag) as reader:
        info, topics = reader.info(), reader.topics().values()
    assert reader.problems == []
    assert info.counts == counts
    assert {topic.name: topic.type_name for topic in topics} == types
    assert info.duration_s == pytest.approx(float(duration[1]), abs=1e-9)
    assert reader.metadata.ros_distro == "jazzy"
    assert all(topic.type_hash.startswith("RIHS01_") for topic in topics)
    assert [t.name for t in topics if is_latched(t.qos[0])] == ["/demo/latched"]


def test_records_come_in_order_and_decode_from_the_bag_alone(genuine_bag: Path) -> None:
    with BagReader(genuine_bag) as reader:
        records = list(reader.records())
        latched = next(
            decode(reader, record) for record in records if record.topic == "/demo/latched"
        )
        depth = next(decode(reader, record) for record in records if record.topic == "/demo/depth")
        temperature = next(
            decode(reader, record) for record in records if record.topic == "/fsw/thermocouple"
        )
    assert [record.log_time_ns for record in records] == sorted(
        record.log_time_ns for record in records
    )
    assert latched.data == "håll 816 °C"
    assert depth.data == pytest.approx(0.00266, rel=1e-2)
    assert temperature.header.frame_id == "tool"
    assert temperature.temperature == pytest.approx(816.0, abs=10.0)


def test_same_records_as_the_reference_reader(genuine: Path) -> None:
    path = genuine / "mcap_zstd" / "mcap_zstd_0.mcap"
    with path.open("rb") as stream:
        expected = [
            (channel.topic, schema.name, message.log_time, message.publish_time, message.data)
            for schema, channel, message in make_reader(stream).iter_messages()
            if schema is not None
        ]
    with BagReader(path) as reader:
        assert [tuple(record)[:5] for record in reader.records()] == expected


def test_selection_of_topics_and_times(genuine: Path) -> None:
    with BagReader(genuine / "mcap_split") as reader:
        everything = list(reader.records())
        middle = everything[len(everything) // 2].log_time_ns
        late = list(reader.records(["/demo/depth"], start_ns=middle))
        early = list(reader.records(["/demo/depth"], stop_ns=middle))
    assert early + late == [record for record in everything if record.topic == "/demo/depth"]
    assert early and late


def test_progress_ends_at_one(genuine_bag: Path) -> None:
    seen: list[float] = []
    with BagReader(genuine_bag) as reader:
        list(reader.records(progress=seen.append))
    assert seen[-1] == 1.0 and all(0.0 <= value <= 1.0 for value in seen)


@pytest.mark.parametrize(
    "yaml", [None, b"", b"\x00\xff\x80", b"a: [", b"rosbag2_bagfile_information: 3"]
)
def test_metadata_may_be_missing_or_broken(
    genuine: Path, tmp_path: Path, yaml: bytes | None
) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(genuine / "mcap_split", bag)
    (bag / "metadata.yaml").unlink()
    if yaml is not None:
        (bag / "metadata.yaml").write_bytes(yaml)
    with BagReader(bag) as reader:
        assert len(list(reader.records())) == 177
        assert any("metadata.yaml" in problem for problem in reader.problems)


@pytest.mark.parametrize("mode", [CompressionMode.MESSAGE, CompressionMode.FILE])
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_bags_compressed_by_message_or_file(
    tmp_path: Path, mode: CompressionMode, storage: StoragePlugin
) -> None:
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(
            "/x", "std_msgs/msg/Float64", msgdef="float64 data\n", rihs01="RIHS01_00"
        )
        for time_ns in range(1, 100):
            writer.write(connection, time_ns, b"\0\1\0\0" + struct.pack("<d", time_ns))
    with BagReader(tmp_path / "bag") as reader:
        assert [
            message.data for message in map(decoder(reader), reader.records(["/x"], 10))
        ] == list(range(10, 100))
        assert reader.info().message_count == 99
        assert (reader.storage, reader.problems) == (storage.name.lower(), [])
        assert sorted(reader.storage_files()) == sorted((tmp_path / "bag").glob("bag*"))


@pytest.mark.parametrize("kind", [".mcap", ".db3"])
def test_compressed_files_need_no_metadata(genuine: Path, tmp_path: Path, kind: str) -> None:
    """A file alone; all of a recorder that was killed, whose last file is not compressed yet.

    One that is cut off.
    """
    parts = {
        ".mcap": sorted((genuine / "mcap_split").glob("*.mcap")),
        ".db3": [genuine / "sqlite3" / "sqlite3_0.db3"],
    }
    *_, last = parts[kind]
    bag = tmp_path / "bag"
    bag.mkdir()
    for path in parts[kind]:
        (bag / f"{path.name}.zstd").write_bytes(zstandard.compress(path.read_bytes()))
    with BagReader(last) as reader, BagReader(bag / f"{last.name}.zstd") as alone:
        whole = list(reader.records())
        assert ([*alone.records()], alone.problems) == (whole, [])
    with BagReader(bag) as reader:
        assert (len([*reader.records()]), len(reader.problems)) == (177, 1)
    (bag / f"{last.name}.zstd").unlink()
    shutil.copy(last, bag)
    with BagReader(bag) as reader:
        assert (len([*reader.records()]), len(reader.problems)) == (177, 1)


def test_compressed_file_that_is_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    random = Random(3)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(RecordedTopic("/x", "std_msgs/msg/String", "string data"))
        for time_ns in range(1, 401):
            writer.write("/x", random.randbytes(1000), time_ns, time_ns)
    with BagReader(tmp_path / "bag") as reader:
        whole = [*reader.records()]
    content = zstandard.compress((tmp_path / "bag" / "bag_0.mcap").read_bytes())
    cut, odd = tmp_path / "cut.mcap.zstd", tmp_path / "odd.mcap.zstd"
    cut.write_bytes(content[: len(content) // 2])
    odd.write_bytes(content[: len(content) // 2] + bytes(range(256)) * 500)
    for path in (cut, odd):
        with BagReader(path) as reader:
            records = [*reader.records()]
            assert 50 < len(records) < 400
            assert records == whole[: len(records)]
            assert any(str(path) in problem for problem in reader.problems)


@pytest.mark.parametrize("in_the_file", [0, 60])
def test_messages_in_the_write_ahead_log_of_a_killed_recorder_are_read(
    genuine: Path, tmp_path: Path, in_the_file: int
) -> None:
    """As rosbag2's preset ``resilient`` leaves them.

    The bag itself may be where nobody can write.
    """
    whole, killed = genuine / "sqlite3" / "sqlite3_0.db3", tmp_path / "killed.db3"
    source, writer = (
        sqlite3.connect(whole),
        sqlite3.connect(tmp_path / "open.db3", isolation_level=None),
    )
    tables = [sql for (sql,) in source.execute("SELECT sql FROM sqlite_master")]
    rows = list(source.execute("SELECT * FROM messages"))
    writer.execute("PRAGMA journal_mode=WAL")
    writer.execute("PRAGMA wal_autocheckpoint=0")
    for sql in tables:
        writer.execute(sql)
    for table in ("schema", "metadata", "topics", "message_definitions"):
        for row in source.execute(f"SELECT * FROM {table}"):
            writer.execute(f"INSERT INTO {table} VALUES ({','.join('?' * len(row))})", row)
    for number, row in enumerate(rows):
        if number == in_the_file > 0:
            writer.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        writer.execute("INSERT INTO messages VALUES (?,?,?,?)", row)
    for suffix in ("", "-wal"):
        shutil.copyfile(tmp_path / f"open.db3{suffix}", f"{killed}{suffix}")
    left = {path.name: path.read_bytes() for path in tmp_path.glob("killed*")}
    with BagReader(killed) as reader, BagReader(whole) as expected:
        assert [*reader.records()] == [*expected.records()]
        assert len(reader.problems) == 1 and "write-ahead log" in reader.problems[0]
    assert {path.name: path.read_bytes() for path in tmp_path.glob("killed*")} == left
    source.close()
    writer.close()


def test_missing_file_of_a_split_bag_is_reported(genuine: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(genuine / "mcap_split", bag)
    (bag / "mcap_split_1.mcap").unlink()
    with BagReader(bag) as reader:
        assert len(list(reader.records())) == 81 + 16
        assert any("mcap_split_1.mcap is missing" in problem for problem in reader.problems)


def test_unlisted_file_is_left_out(genuine: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(genuine / "mcap_split", bag)
    shutil.copy(genuine / "mcap_default" / "mcap_default_0.mcap", bag / "of another weld.mcap")
    with BagReader(bag) as reader, BagReader(genuine / "mcap_split") as expected:
        assert [*reader.records()] == [*expected.records()]
        assert len(reader.problems) == 1 and "of another weld.mcap" in reader.problems[0]
        assert [path.name for path in reader.files()] == [path.name for path in expected.files()]


def test_compressed_rubbish_and_pipes_are_rejected(genuine: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(genuine / "mcap_default", bag)
    os.mkfifo(bag / "pipe.mcap")
    with BagReader(bag) as reader:
        assert reader.problems == []
    large = tmp_path / "large.mcap.zstd"
    large.write_bytes(zstandard.compress(bytes(2**28)))
    with decompressed(large) as copy:
        assert copy.stat().st_size < 100


def test_a_file_that_was_renamed_is_read(genuine: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(genuine / "mcap_default", bag)
    (bag / "mcap_default_0.mcap").rename(bag / "weld 12.mcap")
    with BagReader(bag) as reader, BagReader(genuine / "mcap_default") as expected:
        assert [*reader.records()] == [*expected.records()]


@pytest.mark.parametrize("unknown_ns", [0, 2**64 - 1])
def test_a_receive_time_that_is_not_known_is_not_the_begin_or_end_of_a_bag(
    tmp_path: Path, unknown_ns: int
) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for time_ns in (10**18, unknown_ns, 10**18 + 5):
            writer.write("/a", b"\0\1\0\0", time_ns, time_ns)
    with BagReader(tmp_path / "bag") as reader:
        info = reader.info()
    assert (info.start_ns, info.end_ns, info.message_count) == (10**18, 10**18 + 5, 3)
    assert len(reader.problems) == 1 and "1 messages" in reader.problems[0]
    assert "receive time" in reader.problems[0]


def test_custom_data_are_found_in_the_file_alone(tmp_path: Path) -> None:
    custom = {"canister": "c-12", "tool": "t 7"}
    with BagWriter(tmp_path / "bag", custom_data=custom) as writer:
        writer.write("/a", b"\0\1\0\0", 1, 1)
    shutil.copy(tmp_path / "bag" / "bag_0.mcap", tmp_path / "alone.mcap")
    with BagReader(tmp_path / "alone.mcap") as reader:
        assert reader.metadata.custom_data == custom
        assert reader.metadata.ros_distro == "jazzy"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.mcap", b""),
        ("a.mcap", b"hello world, this is no bag"),
        ("a.db3", b"SQLite format 3\x00 but nothing more"),
        ("a.db3", b""),
        ("a.bag", b"#ROSBAG V2.0\n"),
    ],
)
def test_rubbish_is_refused_with_the_files_name(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BagError, match=re.escape(name)):
        BagReader(tmp_path / name)


def test_nothing_there(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no such bag"):
        BagReader(tmp_path / "missing")
    with pytest.raises(BagError, match="no bag "):
        BagReader(tmp_path)


def test_damaged_message_is_one_clear_error(genuine: Path) -> None:
    with BagReader(genuine / "mcap_default") as reader:
        record = next(
            candidate for candidate in reader.records() if candidate.topic == "/fsw/thermocouple"
        )
        with pytest.raises(BagError, match="Temperature"):
            decode(reader, record._replace(data=record.data[:9]))


def test_definition_that_cannot_be_parsed() -> None:
    with pytest.raises(BagError, match="cannot be parsed"):
        Definitions().decode("a_msgs/msg/A", "this is } no definition", b"\0\1\0\0")
