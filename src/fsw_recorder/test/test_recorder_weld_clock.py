"""Time of the weld instead of that of its recording."""

import struct
from pathlib import Path

import numpy as np
import pytest

from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter, RecordedTopic
from fsw_recorder.player import Player
from fsw_recorder.weld_clock import WeldClockReader, on_weld_clock

BEGIN_NS = 1_700_000_000_000_000_000
TICK_NS = 100_000_000
#: received within this per tick: a weld that ran a hundred times faster than it was
FAST_NS = 1_000_000


def write(bag: Path, stamps: list[int], period_ns: int = FAST_NS) -> Path:
    with BagWriter(bag) as writer:
        for name in ("/early", "/fsw/depth", "/fsw/command"):
            writer.add_topic(RecordedTopic(name, "fsw_msgs/msg/ShoulderDepth"))
        writer.write("/early", b"0" * 12, BEGIN_NS - 5_000_000_000, BEGIN_NS)
        for tick, stamp in enumerate(stamps):
            data = b"\x00\x01\x00\x00" + struct.pack("<iI", stamp // 10**9, stamp % 10**9)
            received = BEGIN_NS + tick * period_ns
            writer.write("/fsw/depth", data, received, received)
            writer.write("/fsw/command", data, received + period_ns * 9 // 10, received)
    return bag


def paced(reader: BagReader) -> WeldClockReader:
    weld = on_weld_clock(reader)
    assert isinstance(weld, WeldClockReader)
    return weld


def test_measurements_have_their_stamps_and_commands_follow_soon(tmp_path: Path) -> None:
    stamps = [(tick + 1) * TICK_NS for tick in range(100)]
    with BagReader(write(tmp_path / "bag", stamps)) as reader:
        weld = paced(reader)
        depths = [record.log_time_ns for record in weld.records(["/fsw/depth"])]
        commands = [record.log_time_ns for record in weld.records(["/fsw/command"])]
        everything = [record.log_time_ns for record in weld.records()]
        info = weld.info()
    assert depths == stamps and everything == sorted(everything) and len(everything) == 201
    assert all(
        0 < later - stamp <= TICK_NS // 5
        for stamp, later in zip(stamps[:-1], commands[:-1], strict=True)
    )
    assert info.start_ns == stamps[0] and info.duration_s == pytest.approx(9.9, abs=0.01)


def test_a_part_is_cut_on_the_weld_clock(tmp_path: Path) -> None:
    stamps = [(tick + 1) * TICK_NS for tick in range(100)]
    with BagReader(write(tmp_path / "bag", stamps)) as reader:
        weld = paced(reader)
        part = [
            record.log_time_ns
            for record in weld.records(["/fsw/depth"], start_ns=stamps[20], stop_ns=stamps[30])
        ]
        player = Player(weld, 0, start_offset_s=2.0, duration_s=1.0)
        played = [record.log_time_ns for record in player.take_due(10**12)]
    assert part == stamps[20:30]
    assert played[0] == stamps[20] and played[-1] == stamps[30]


def test_weld_clock_continues_after_a_plant_reset(tmp_path: Path) -> None:
    stamps = [(tick + 1) * TICK_NS for tick in range(50)] * 2
    with BagReader(write(tmp_path / "bag", stamps)) as reader:
        times = [record.log_time_ns for record in paced(reader).records(["/fsw/depth"])]
    assert (
        times[:50] == stamps[:50]
        and all(np.diff(times) >= 0)
        and times[-1] == stamps[-1] + stamps[49] - TICK_NS
    )


def test_weld_on_the_wall_clock_is_left_as_it_is(tmp_path: Path) -> None:
    stamps = [BEGIN_NS + tick * TICK_NS for tick in range(20)]
    with BagReader(write(tmp_path / "bag", stamps, TICK_NS)) as reader:
        assert on_weld_clock(reader) is reader


def test_bag_of_something_else(genuine_bag: Path) -> None:
    with BagReader(genuine_bag) as reader:
        assert on_weld_clock(reader) is reader


def test_stall_is_not_caught_up(tmp_path: Path) -> None:
    stamps = [(tick + 1) * TICK_NS for tick in range(100)]
    with BagReader(write(tmp_path / "bag", stamps)) as reader:
        player = Player(paced(reader), 0, topics=frozenset({"/fsw/depth"}))
        assert len(player.take_due(TICK_NS)) == 2
        player.hold_back(20 * TICK_NS)
        assert len(player.take_due(22 * TICK_NS)) == 1


def test_order_of_receipt_does_not_part_a_tick(tmp_path: Path) -> None:
    names = ("/fsw/depth", "/fsw/thermocouple", "/fsw/command")
    with BagWriter(tmp_path / "bag") as writer:
        for name in names:
            writer.add_topic(RecordedTopic(name, "fsw_msgs/msg/ShoulderDepth"))
        for tick in range(50):
            stamp = (tick + 1) * TICK_NS
            data = b"\x00\x01\x00\x00" + struct.pack("<iI", stamp // 10**9, stamp % 10**9)
            received = BEGIN_NS + tick * FAST_NS
            writer.write("/fsw/depth", data, received, received)
            for name in names[1:]:  # read by the recorder only after the depth of the next tick
                writer.write(name, data, received + FAST_NS * 11 // 10, received)
    with BagReader(tmp_path / "bag") as reader:
        played = [(record.topic, record.log_time_ns) for record in paced(reader).records()]
    assert [name for name, _ in played] == ["/fsw/depth", "/fsw/thermocouple", "/fsw/command"] * 50
    assert [time for name, time in played if name == names[1]] == [
        (tick + 1) * TICK_NS for tick in range(50)
    ]
