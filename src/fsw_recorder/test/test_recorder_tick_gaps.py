"""Ticks that are missing in a bag, found by their stamps."""

import struct

from hypothesis import given
from hypothesis import strategies as st

from fsw_recorder.bag_reader import BagRecord
from fsw_recorder.weld_clock import TickCounter, TickGaps, is_ticking, stamp_ns

PERIOD_NS = 100_000_000


def message(stamp: int) -> bytes:
    return b"\x00\x01\x00\x00" + struct.pack("<iI", stamp // 10**9, stamp % 10**9)


def note(counter: TickCounter, topic: str, data: bytes) -> None:
    counter.note(BagRecord(topic, "", 0, 0, data, 0))


def counted(**ticks: set[int]) -> dict[str, int]:
    counter = TickCounter()
    for topic, numbers in ticks.items():
        for number in sorted(numbers):
            note(counter, f"/fsw/{topic}", message((number + 1) * PERIOD_NS))
    return {topic.removeprefix("/fsw/"): gaps.missing for topic, gaps in counter.gaps().items()}


def test_which_topics_tick() -> None:
    assert all(
        is_ticking(f"/fsw/{topic}")
        for topic in ("depth", "command", "nmpc/proposal", "plant/truth", "a/status", "drives")
    )
    assert is_ticking("/hall/cell1/fsw/depth")
    assert not any(
        is_ticking(topic)
        for topic in ("/fsw/reference", "/fsw/supervisor/state", "/clock", "/demo/depth")
    )


def test_stamp_is_little_endian() -> None:
    assert stamp_ns(message(1_234_567_890)) == 1_234_567_890
    assert stamp_ns(b"\x00\x00\x00\x00" + struct.pack(">iI", 1, 5)) is None
    assert stamp_ns(b"\x00\x01\x00\x00\x01") is None


def test_nothing_to_judge() -> None:
    assert TickCounter().gaps() == {}
    assert counted(depth={3}) == {"depth": 0}


@given(st.sets(st.integers(1, 198), max_size=40))
def test_gaps_are_counted_per_topic(lost: set[int]) -> None:
    every = set(range(200))
    assert counted(depth=every, command=every - lost) == {"depth": 0, "command": len(lost)}


@given(st.sets(st.integers(1, 198), max_size=40))
def test_ticks_that_all_topics_lack(lost: set[int]) -> None:
    assert counted(depth=set(range(200)) - lost) == {"depth": len(lost)}


def test_late_begin_and_early_end_are_counted_apart() -> None:
    counter = TickCounter()
    for number in range(100):
        note(counter, "/fsw/depth", message((number + 1) * PERIOD_NS))
        if 20 <= number < 50 and number != 30:
            note(counter, "/fsw/nmpc/proposal", message((number + 1) * PERIOD_NS))
    assert counter.gaps()["/fsw/nmpc/proposal"] == TickGaps(1, 31 * PERIOD_NS, 20, 50)
    assert counter.gaps()["/fsw/depth"] == TickGaps(0, 0, 0, 0)


@given(st.lists(st.binary(max_size=20), max_size=50))
def test_any_bytes_are_judged_in_bounded_memory(messages: list[bytes]) -> None:
    counter = TickCounter()
    for data in messages:
        note(counter, "/fsw/depth", data)
    assert all(0 <= gap.missing < 10_000_000 for gap in counter.gaps().values())
