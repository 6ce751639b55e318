"""One weld in the bags of other recorders, versions and accidents.

The same figures from each, and its recovered copy.

Each form follows a public report or a version of rosbag2. What each form can lose is tested beside
the reader.
"""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mcap.writer
import pytest
import yaml
import zstandard
from mcap.writer import CompressionType, IndexType

from fsw_analysis import kpi
from fsw_analysis.signals import load_weld
from fsw_recorder.bag_reader import BagReader, BagRecord
from fsw_recorder.recover import recover
from fsw_recorder.topic import RecordedTopic, TopicSelection
from fsw_test_support.sample_weld import write_sample_weld

TICKS = 120
HOUR_NS = 3_600_000_000_000
SQL = {
    1: "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
    "serialization_format TEXT)",
    2: "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
    "serialization_format TEXT, offered_qos_profiles TEXT)",
    4: "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
    "serialization_format TEXT, offered_qos_profiles TEXT, type_description_hash TEXT)",
}


@dataclass(frozen=True)
class Source:
    """Content of the weld's bag."""

    folder: Path
    topics: dict[str, RecordedTopic]
    records: list[BagRecord]
    scenario: bytes


Make = Callable[[Source, Path], None]
#: by name: writes the weld into an empty folder; the number of remarks on reading it; receive
#: times may be wrong
FORMS: dict[str, tuple[Make, int]] = {}


def form(name: str, remarks: int = 0) -> Callable[[Make], Make]:
    """Add a form of the bag."""

    def add(make: Make) -> Make:
        FORMS[name] = make, remarks
        return make

    return add


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    folder = tmp_path_factory.mktemp("corpus") / "weld"
    write_sample_weld(folder, TICKS)
    with BagReader(folder) as reader:
        (scenario,) = reader.attachments()
        return Source(folder, reader.topics(), list(reader.records()), scenario.data)


def write_mcap(
    path: Path,
    source: Source,
    records: Iterable[BagRecord] | None = None,
    definition: Callable[[RecordedTopic], tuple[str, bytes]] = lambda topic: (
        "ros2msg",
        topic.definition.encode(),
    ),
    **options: Any,
) -> None:
    """One MCAP file by the reference library, in the order given."""
    with path.open("wb") as stream:
        writer = mcap.writer.Writer(stream, **options)
        writer.start("ros2", "corpus")
        channels = {}
        for name, topic in source.topics.items():
            encoding, text = definition(topic)
            schema = writer.register_schema(topic.type_name, encoding, text)
            channels[name] = writer.register_channel(name, "cdr", schema)
        for record in source.records if records is None else records:
            writer.add_message(
                channels[record.topic],
                record.log_time_ns,
                record.data,
                record.publish_time_ns,
                record.sequence,
            )
        writer.add_attachment(0, 0, "scenario.yaml", "application/yaml", source.scenario)
        writer.finish()


def write_sqlite(
    path: Path, source: Source, version: int, journal: str = "DELETE"
) -> sqlite3.Connection:
    """One sqlite3 file with rosbag2's tables of a version.

    1 before Foxy, 2 Foxy, 3 Humble, 4 Iron to Rolling.
    """
    base = sqlite3.connect(path, isolation_level=None)
    base.execute(f"PRAGMA journal_mode={journal}")
    base.execute("PRAGMA wal_autocheckpoint=0")
    base.execute(SQL[max(known for known in SQL if known <= version)])
    base.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, "
        "timestamp INTEGER, data BLOB)"
    )
    if version >= 3:
        base.execute(
            "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)"
        )
        base.execute(
            "INSERT INTO schema VALUES (?, ?)", (version, "humble" if version == 3 else "rolling")
        )
        base.execute(
            "CREATE TABLE metadata(id INTEGER PRIMARY KEY, "
            "metadata_version INTEGER, metadata TEXT)"
        )
    if version >= 4:
        base.execute(
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, "
            "encoding TEXT, encoded_message_definition TEXT, type_description_hash TEXT)"
        )
    numbers = {name: number for number, name in enumerate(source.topics, 1)}
    for name, topic in source.topics.items():
        values = [
            numbers[name],
            name,
            topic.type_name,
            "cdr",
            *["", topic.type_hash][: max(0, min(version, 4) // 2)],
        ]
        base.execute(f"INSERT INTO topics VALUES ({','.join('?' * len(values))})", values)
        if version >= 4:
            row = (numbers[name], topic.type_name, "ros2msg", topic.definition, topic.type_hash)
            base.execute("INSERT INTO message_definitions VALUES (?,?,?,?,?)", row)
    base.execute("BEGIN")
    for number, record in enumerate(source.records):
        row = (number, numbers[record.topic], record.log_time_ns, record.data)
        base.execute("INSERT INTO messages VALUES (?,?,?,?)", row)
    base.execute("COMMIT")
    return base


def metadata(
    version: int, storage: str, files: list[str], source: Source, **changes: Any
) -> bytes:
    """Text of metadata.yaml in a version of rosbag2: 4 Foxy, 5 Humble, 9 Jazzy and Rolling."""
    begin, end = (source.records[index].log_time_ns for index in (0, -1))
    counts = {
        name: sum(record.topic == name for record in source.records) for name in source.topics
    }
    times = {
        "starting_time": {"nanoseconds_since_epoch": begin},
        "duration": {"nanoseconds": end - begin},
    }
    topics = []
    for name, topic in source.topics.items():
        own = {
            "name": name,
            "type": topic.type_name,
            "serialization_format": "cdr",
            "offered_qos_profiles": "",
        }
        own |= (
            {"type_description_hash": topic.type_hash, "offered_qos_profiles": []}
            if version >= 9
            else {}
        )
        topics.append({"topic_metadata": own, "message_count": counts[name]})
    content = {
        "version": version,
        "storage_identifier": storage,
        "relative_file_paths": files,
        **times,
        "message_count": len(source.records),
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
    }
    if version >= 5:
        content["files"] = [
            {"path": name, **times, "message_count": len(source.records)} for name in files
        ]
    if version >= 9:
        content |= {"custom_data": None, "ros_distro": "rolling"}
    return yaml.safe_dump({"rosbag2_bagfile_information": content | changes}).encode()


def compress(path: Path) -> None:
    """Compress a file as rosbag2 does."""
    path.with_name(f"{path.name}.zstd").write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()


@form("as this recorder writes it")
def _(source: Source, bag: Path) -> None:
    shutil.copytree(source.folder, bag, dirs_exist_ok=True)


for _name, _options in {
    "mcap, not in chunks": {"use_chunking": False},
    "mcap, without index": {
        "index_types": IndexType.NONE,
        "use_statistics": False,
        "use_summary_offsets": False,
    },
    "mcap, no copies in the summary": {"repeat_channels": False, "repeat_schemas": False},
    "mcap, lz4": {"compression": CompressionType.LZ4},
    "mcap, zstd, small chunks": {"compression": CompressionType.ZSTD, "chunk_size": 4096},
    "mcap, checksum of all data": {"enable_data_crcs": True},
}.items():

    @form(_name, remarks=1)
    def _(source: Source, bag: Path, options: dict[str, Any] = _options) -> None:
        write_mcap(bag / "weld.mcap", source, **options)


@form("mcap, out of order", remarks=1)
def _(source: Source, bag: Path) -> None:
    write_mcap(bag / "weld.mcap", source, source.records[::-1], chunk_size=8192)


@form("mcap without definitions", remarks=1)
def _(source: Source, bag: Path) -> None:
    write_mcap(bag / "weld.mcap", source, definition=lambda topic: ("", b""))


@form("mcap with definitions in IDL", remarks=1)
def _(source: Source, bag: Path) -> None:
    write_mcap(
        bag / "weld.mcap",
        source,
        definition=lambda topic: ("ros2idl", b"module fsw_msgs { module msg { }; };"),
    )


@form("mcap, clock of the recorder set back by an hour in mid-weld", remarks=2)
def _(source: Source, bag: Path) -> None:
    half = source.records[len(source.records) // 2].log_time_ns
    back = [
        record._replace(log_time_ns=record.log_time_ns - HOUR_NS * (record.log_time_ns > half))
        for record in source.records
    ]
    write_mcap(bag / "weld.mcap", source, back)


@form("mcap, all messages twice", remarks=2)
def _(source: Source, bag: Path) -> None:
    write_mcap(
        bag / "weld.mcap",
        source,
        [record for original in source.records for record in (original, original)],
    )


for _unknown in (0, 2**64 - 1):

    @form(f"mcap, receive time {_unknown} now and then", remarks=2)
    def _(source: Source, bag: Path, unknown: int = _unknown) -> None:
        odd = [
            record._replace(log_time_ns=unknown) if k % 97 == 5 else record
            for k, record in enumerate(source.records)
        ]
        write_mcap(bag / "weld.mcap", source, odd)


@form("mcap, a file of another weld beside", remarks=1)
def _(source: Source, bag: Path) -> None:
    shutil.copytree(source.folder, bag, dirs_exist_ok=True)
    write_mcap(bag / "other.mcap", source, source.records[: len(source.records) // 3])


@form("mcap, copied file beside", remarks=1)
def _(source: Source, bag: Path) -> None:
    shutil.copytree(source.folder, bag, dirs_exist_ok=True)
    shutil.copy(next(bag.glob("*.mcap")), bag / "copy of it.mcap")


@form("mcap, empty metadata.yaml", remarks=1)
def _(source: Source, bag: Path) -> None:
    shutil.copytree(source.folder, bag, dirs_exist_ok=True)
    (bag / "metadata.yaml").write_bytes(b"")


@form("mcap, compressed as a file by rosbag2")
def _(source: Source, bag: Path) -> None:
    write_mcap(bag / "weld_0.mcap", source)
    compress(bag / "weld_0.mcap")
    changes = {"compression_format": "zstd", "compression_mode": "FILE"}
    (bag / "metadata.yaml").write_bytes(
        metadata(9, "mcap", ["weld_0.mcap.zstd"], source, **changes)
    )


@form("mcap, compressed as a file, listed without its suffix")
def _(source: Source, bag: Path) -> None:
    FORMS["mcap, compressed as a file by rosbag2"][0](source, bag)
    changes = {"compression_format": "zstd", "compression_mode": "FILE"}
    (bag / "metadata.yaml").write_bytes(metadata(9, "mcap", ["weld_0.mcap"], source, **changes))


for _changed, _listed, _compressed in (
    ("decompressed", ["weld_0.mcap.zstd", "weld_1.mcap.zstd"], "weld_1.mcap"),
    ("compressed", ["weld_0.mcap", "weld_1.mcap"], "weld_0.mcap"),
):

    @form(f"mcap in two files, the first {_changed} since")
    def _(
        source: Source, bag: Path, listed: list[str] = _listed, compressed: str = _compressed
    ) -> None:
        half = len(source.records) // 2
        write_mcap(bag / "weld_0.mcap", source, source.records[:half])
        write_mcap(bag / "weld_1.mcap", source, source.records[half:])
        compress(bag / compressed)
        (bag / "metadata.yaml").write_bytes(metadata(9, "mcap", listed, source))


@form("mcap, compressed as a file by hand", remarks=1)
def _(source: Source, bag: Path) -> None:
    FORMS["mcap, compressed as a file by rosbag2"][0](source, bag)
    (bag / "metadata.yaml").unlink()


for _version, _distro, _metadata in (
    (1, "Eloquent", 3),
    (2, "Foxy", 4),
    (3, "Humble", 5),
    (4, "Rolling", 9),
):

    @form(f"sqlite3 of {_distro}")
    def _(
        source: Source, bag: Path, version: int = _version, of_metadata: int = _metadata
    ) -> None:
        write_sqlite(bag / "weld_0.db3", source, version).close()
        (bag / "metadata.yaml").write_bytes(
            metadata(of_metadata, "sqlite3", ["weld_0.db3"], source)
        )


for _version in (2, 4):

    @form(f"sqlite3 of version {_version}, recorder killed with its write-ahead log", remarks=2)
    def _(source: Source, bag: Path, version: int = _version) -> None:
        place = bag.parent / "open"
        place.mkdir()
        base = write_sqlite(place / "weld_0.db3", source, version, "WAL")
        for path in place.glob("weld_0.db3*"):
            if not path.name.endswith("-shm"):
                shutil.copy(path, bag)
        base.close()


@form("sqlite3, compressed as a file by rosbag2")
def _(source: Source, bag: Path) -> None:
    write_sqlite(bag / "weld_0.db3", source, 4).close()
    compress(bag / "weld_0.db3")
    changes = {"compression_format": "zstd", "compression_mode": "FILE"}
    (bag / "metadata.yaml").write_bytes(
        metadata(9, "sqlite3", ["weld_0.db3.zstd"], source, **changes)
    )


def figures(path: Path) -> tuple[str, list[str]]:
    """Figures of merit of a bag, and what is remarked on it."""
    signals = load_weld(path)
    return json.dumps(kpi.compute(signals, "weld"), sort_keys=True), signals.problems


@pytest.fixture(scope="module")
def expected(source: Source) -> str:
    return figures(source.folder)[0]


@pytest.mark.parametrize("name", FORMS)
def test_same_figures_from_each_form_and_from_its_recovered_copy(
    name: str, source: Source, expected: str, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    make, remarks = FORMS[name]
    make(source, bag)
    values, problems = figures(bag)
    assert values == expected
    assert len(problems) == remarks, problems
    recover(bag, tmp_path / "copy", selection=TopicSelection(include_hidden=True))
    assert figures(tmp_path / "copy")[0] == expected
    with BagReader(bag) as reader, BagReader(tmp_path / "copy") as copy:
        assert copy.info().message_count == reader.info().message_count
