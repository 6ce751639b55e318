"""Damage costs the records that it hits, and no others."""

import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from fsw_recorder.bag_reader import BagReader
from fsw_recorder.recover import recover

COUNT = 1000
HEAD = 9


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A file of 1,000 messages outside chunks, as ``ros2 bag record`` writes by default."""
    path = tmp_path_factory.mktemp("plain") / "plain.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/x", "cdr", schema, {"offered_qos_profiles": ""})
        for index in range(COUNT):
            writer.add_message(
                channel,
                10**9 + index,
                b"\0\1\0\0" + struct.pack("<d", index),
                10**9 + index,
                index,
            )
        writer.finish()
    return path.read_bytes()


def frames_of(content: bytes, opcode: int) -> list[int]:
    """Offsets of all records of a kind."""
    offsets, offset = [], 8
    while offset + HEAD < len(content):
        if content[offset] == opcode:
            offsets.append(offset)
        offset += HEAD + int.from_bytes(content[offset + 1 : offset + HEAD], "little")
    return offsets


def indices(path: Path, content: bytes) -> tuple[list[int], list[str]]:
    path.write_bytes(content)
    with BagReader(path) as reader:
        read = [record.sequence for record in reader.records()]
        return read, reader.problems


def changed(content: bytes, offset: int, new: bytes) -> bytes:
    return content[:offset] + new + content[offset + len(new) :]


def test_short_message_loses_itself_only(content: bytes, tmp_path: Path) -> None:
    offset = frames_of(content, 5)[400]
    short = (
        content[:offset] + struct.pack("<BQ", 5, 10) + bytes(10) + content[offset + HEAD + 34 :]
    )
    read, problems = indices(tmp_path / "a.mcap", short)
    assert read == [index for index in range(COUNT) if index != 400]
    assert any("damaged" in problem for problem in problems)


def test_bad_schema_loses_no_message(content: bytes, tmp_path: Path) -> None:
    offset = frames_of(content, 3)[0]
    bad = changed(content, offset + HEAD + 6, b"\xff\xfe\xff")
    read, problems = indices(tmp_path / "a.mcap", bad)
    assert read == list(range(COUNT)) and any("schema" in problem for problem in problems)
    with BagReader(tmp_path / "a.mcap") as reader:  # its copy at the end of the file is used
        assert reader.topics()["/x"].type_name == "std_msgs/msg/Float64"


@pytest.mark.parametrize("length", [0, 1, 33, 35, 1000, 2**20, 2**40, 2**64 - 1])
def test_wrong_length_loses_itself_only(content: bytes, tmp_path: Path, length: int) -> None:
    offset = frames_of(content, 5)[400]
    read, problems = indices(
        tmp_path / "a.mcap", changed(content, offset, struct.pack("<BQ", 5, length))
    )
    assert set(range(COUNT)) - set(read) <= {400} and len(read) <= COUNT and problems


def test_hole_loses_only_its_messages(content: bytes, tmp_path: Path) -> None:
    messages = frames_of(content, 5)
    for fill in (b"\0", b"\xff", b"\x05"):
        hole = changed(content, messages[300], fill * (messages[500] - messages[300] + 20))
        read, problems = indices(tmp_path / "a.mcap", hole)
        assert set(read) >= {*range(300), *range(502, COUNT)} and len(read) <= 800 and problems


@pytest.mark.requirement("S23")
@settings(
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=st.data())
def test_a_few_damaged_bytes_lose_a_few_messages(
    content: bytes, tmp_path: Path, data: st.DataObject
) -> None:
    first, last = frames_of(content, 5)[0], frames_of(content, 5)[-1]
    damaged = content
    hits = data.draw(st.lists(st.integers(first, last), min_size=1, max_size=5))
    for hit in hits:
        damaged = changed(damaged, hit, bytes([data.draw(st.integers(0, 255))]))
    messages = frames_of(content, 5)
    ends = [
        message + HEAD + int.from_bytes(damaged[message + 1 : message + HEAD], "little")
        for message in messages
    ]
    # a length that by chance ends where another record begins cannot be told from a good one
    assume(
        all(
            end == right or end not in messages
            for end, right in zip(ends, messages[1:], strict=False)
        )
    )
    read, _ = indices(tmp_path / "a.mcap", damaged)
    # a hit takes at most the message that it is in and its neighbour; damaged numbers may repeat
    assert len(set(read) & set(range(COUNT))) >= COUNT - 3 * len(hits)


@pytest.mark.requirement("S23")
def test_recovered_bag_is_whole(content: bytes, tmp_path: Path) -> None:
    messages = frames_of(content, 5)
    hole = changed(content, messages[300], bytes(messages[310] - messages[300] + 20))
    (tmp_path / "hole.mcap").write_bytes(hole[: messages[900] + 5])
    result = recover(tmp_path / "hole.mcap", tmp_path / "whole")
    assert result.messages == 900 - 11 and result.problems
    with BagReader(tmp_path / "whole") as reader:
        assert reader.info().message_count == 889 and reader.problems == []
