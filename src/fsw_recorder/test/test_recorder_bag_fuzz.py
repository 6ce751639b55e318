"""Whatever the bytes: an answer or a BagError, in bounded time and memory."""

import shutil
import sqlite3
import struct
import tracemalloc
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fsw_recorder import BagError
from fsw_recorder.bag_reader import BagReader, BagRecord
from fsw_recorder.mcap_file import MAGIC
from fsw_test_support.bags import GENUINE, decoder
from fsw_test_support.sample_weld import write_sample_weld

pytestmark = pytest.mark.slow

MCAP = (GENUINE / "mcap_default" / "mcap_default_0.mcap").read_bytes()
CHUNKED = (GENUINE / "mcap_zstd" / "mcap_zstd_0.mcap").read_bytes()
FILE_ZSTD = (GENUINE / "mcap_filezstd" / "mcap_filezstd_0.mcap.zstd").read_bytes()
SQLITE = (GENUINE / "sqlite3" / "sqlite3_0.db3").read_bytes()


@pytest.fixture(scope="module")
def split_weld(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Content of a bag of several chunks."""
    folder = tmp_path_factory.mktemp("chunks") / "weld"
    write_sample_weld(folder, 60, in_chunk=100)
    return (folder / "weld_0.mcap").read_bytes()


fuzz = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@contextmanager
def bounded_memory(limit: int = 64 * 1024 * 1024) -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit
    finally:
        tracemalloc.stop()


def read(path: Path, content: bytes | None = None) -> list[BagRecord] | None:
    """Everything that the tools do with a bag, written first of ``content``.

    None when it is refused.
    """
    if content is not None:
        path.write_bytes(content)
    try:
        with BagReader(path) as reader:
            info = reader.info()
            records = list(reader.records())
            assert info.message_count == len(records)
            decode = decoder(reader)
            for record in records[:20]:
                try:
                    decode(record)
                except BagError as error:
                    assert str(error)
        return records
    except BagError as error:
        assert path.name in str(error)
        return None


@fuzz
@given(content=st.binary(max_size=2000))
def test_random_bytes(tmp_path: Path, content: bytes) -> None:
    read(tmp_path / "a.mcap", content)
    read(tmp_path / "b.mcap", MAGIC + content)
    read(tmp_path / "d.db3", b"SQLite format 3\x00" + content)


@fuzz
@given(data=st.data())
def test_records_of_random_kind_and_length(tmp_path: Path, data: st.DataObject) -> None:
    content = MAGIC
    for _ in range(data.draw(st.integers(1, 8))):
        body = data.draw(st.binary(max_size=60))
        length = (
            data.draw(st.sampled_from([len(body), len(body) - 1, 0, 2**31, 2**63, 2**64 - 1]))
            % 2**64
        )
        content += struct.pack("<BQ", data.draw(st.integers(0, 255)), length) + body
    with bounded_memory():
        read(tmp_path / "a.mcap", content)


@fuzz
@given(data=st.data())
def test_flipped_bits(tmp_path: Path, data: st.DataObject) -> None:
    original = data.draw(st.sampled_from([MCAP, CHUNKED]))
    content = bytearray(original)
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    read(tmp_path / "a.mcap", bytes(content))


@fuzz
@given(position=st.integers(0, len(SQLITE) - 1), value=st.integers(0, 255), cut=st.booleans())
def test_damaged_sqlite(tmp_path: Path, position: int, value: int, cut: bool) -> None:
    content = bytearray(SQLITE)
    content[position] = value
    read(tmp_path / "a.db3", bytes(content[:position] if cut else content))


@fuzz
@given(position=st.integers(0, len(FILE_ZSTD) - 1), value=st.integers(0, 255), cut=st.booleans())
@pytest.mark.full
def test_damaged_compressed_file(tmp_path: Path, position: int, value: int, cut: bool) -> None:
    content = bytearray(FILE_ZSTD)
    content[position] = value
    bag = tmp_path / "mcap_filezstd"
    bag.mkdir(exist_ok=True)
    shutil.copy(GENUINE / "mcap_filezstd" / "metadata.yaml", bag)
    (bag / "mcap_filezstd_0.mcap.zstd").write_bytes(content[:position] if cut else content)
    read(bag)


@pytest.mark.requirement("S23")
@fuzz
@given(cut=st.integers(0, len(MCAP)))
def test_cut_bag_is_identical_up_to_the_cut(tmp_path: Path, cut: int) -> None:
    with BagReader(GENUINE / "mcap_default" / "mcap_default_0.mcap") as reader:
        whole = list(reader.records())
    rest = read(tmp_path / "cut.mcap", MCAP[:cut]) or []
    assert rest == whole[: len(rest)]
    # Each whole message before the cut is there: a message takes at most 31 bytes and its data.
    if rest and len(rest) < len(whole):
        end_of_next = MCAP.index(whole[len(rest)].data, MCAP.index(rest[-1].data)) + len(
            whole[len(rest)].data
        )
        assert end_of_next > cut


def chunk_of(content: bytes, announced: int, compression: bytes = b"zstd") -> bytes:
    body = (
        struct.pack("<QQQI", 0, 1, announced, 0)
        + struct.pack("<I", len(compression))
        + compression
    )
    body += struct.pack("<Q", len(content)) + content
    return MAGIC + struct.pack("<BQ", 6, len(body)) + body


@pytest.mark.parametrize("announced", [10, 2**40])
def test_chunk_that_expands_without_end(tmp_path: Path, announced: int) -> None:
    bomb = zstandard.compress(bytes(600 * 1024 * 1024))
    with bounded_memory(400 * 1024 * 1024):
        assert not read(tmp_path / "a.mcap", chunk_of(bomb, announced))


def test_unknown_compression_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(chunk_of(b"abc", 3, b"brotli"))
    with BagReader(path) as reader:
        assert list(reader.records()) == []
        assert any("brotli" in problem for problem in reader.problems)


def chunks_of(content: bytes) -> list[int]:
    return [
        offset
        for offset in range(8, len(content) - 9)
        if content[offset] == 6 and _is_chunk(content, offset)
    ]


@pytest.mark.requirement("S23")
def test_damaged_chunk_is_skipped_and_reported(split_weld: bytes, tmp_path: Path) -> None:
    whole = read(tmp_path / "whole.mcap", split_weld)
    chunks = chunks_of(split_weld)
    content = bytearray(split_weld)
    content[chunks[1] + 500] ^= 0xFF
    path = tmp_path / "a.mcap"
    path.write_bytes(bytes(content))
    with BagReader(path) as reader:
        rest = list(reader.records())
        assert any("checksum" in problem for problem in reader.problems)
    assert whole is not None and 0 < len(rest) < len(whole)
    assert [record for record in whole if record in set(rest)] == rest


def test_damaged_head_of_a_chunk_costs_nothing(split_weld: bytes, tmp_path: Path) -> None:
    whole = read(tmp_path / "whole.mcap", split_weld)
    content = bytearray(split_weld)
    content[chunks_of(split_weld)[1]] = 0x11  # the record's type becomes one that does not exist
    path = tmp_path / "a.mcap"
    path.write_bytes(bytes(content))
    with BagReader(path) as reader:
        assert list(reader.records()) == whole
        assert any("damaged" in problem for problem in reader.problems)


def _is_chunk(content: bytes, offset: int) -> bool:
    (length,) = struct.unpack_from("<Q", content, offset + 1)
    if not 40 < length < len(content) - offset - 9:
        return False
    body = bytes(content[offset + 9 : offset + 9 + length])
    size, crc = struct.unpack_from("<QI", body, 16)
    return size == length - 40 and zlib.crc32(body[40:]) == crc


def test_sqlite_without_tables(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE other (id INTEGER)")
    connection.commit()
    connection.close()
    with pytest.raises(BagError, match=r"a\.db3"):
        BagReader(path)
