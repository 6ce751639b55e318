"""The player publishes the right message at the right time of any clock."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from fsw_recorder import BagError
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.player import Player

S = 1_000_000_000


@pytest.fixture
def reader(genuine: Path) -> Iterator[BagReader]:
    with BagReader(genuine / "mcap_split") as opened:
        yield opened


def played(
    player: Player, until_ns: int, step_ns: int = 10_000_000, start_ns: int = 0
) -> list[tuple[int, int]]:
    """Clock time and log time of everything published."""
    result = []
    for now in range(start_ns, until_ns + 1, step_ns):
        result += [(now, record.log_time_ns) for record in player.take_due(now)]
    return result


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_rate(reader: BagReader, rate: float) -> None:
    info = reader.info()
    player = Player(reader, 0, rate=rate)
    seen = played(player, round(info.duration_s / rate * S) + 20_000_000)
    assert len(seen) == 177 and player.finished
    for now, log_time in seen:
        due_s = (log_time - info.start_ns) / rate
        assert -1 <= now - due_s <= 10_000_001


def test_pause_resume_and_change_of_rate(reader: BagReader) -> None:
    player = Player(reader, 0)
    first = played(player, S)
    player.pause(S)
    time_ns = player.bag_time_ns(S)
    assert played(player, 3 * S, start_ns=S) == [] and player.bag_time_ns(3 * S) == time_ns
    player.resume(3 * S)
    assert (
        player.set_rate(10.0, 3 * S)
        and not player.set_rate(0.0, 3 * S)
        and not player.set_rate(-1.0, 3 * S)
    )
    rest = played(player, 4 * S, start_ns=3 * S)
    assert len(first) + len(rest) == 177 and player.rate == 10.0


def test_step(reader: BagReader) -> None:
    records = list(reader.records())
    player = Player(reader, 0, paused=True)
    assert [player.step(0) for _ in range(3)] == records[:3]
    assert player.bag_time_ns(5 * S) == records[2].log_time_ns
    player.resume(5 * S)
    assert player.step(5 * S) is None
    assert len(played(player, 10 * S, start_ns=5 * S)) == 174
    player.pause(10 * S)
    assert player.step(10 * S) is None


def test_seek(reader: BagReader) -> None:
    info = reader.info()
    player = Player(reader, 0)
    assert player.seek(info.end_ns - S, 0)
    assert 40 <= len(played(player, 2 * S)) <= 50 and player.finished
    assert player.seek(info.start_ns, 2 * S) and not player.finished
    assert len(played(player, 8 * S, start_ns=2 * S)) == 177
    assert not player.seek(info.start_ns - 1, 0) and not player.seek(info.end_ns + 1, 0)


def test_offset_duration_and_latched(reader: BagReader) -> None:
    player = Player(reader, 0, start_offset_s=2.0, duration_s=1.0)
    assert [record.topic for record in player.latched_before_start()] == ["/demo/latched"]
    assert 38 <= len(played(player, 2 * S)) <= 42
    assert Player(reader, 0).latched_before_start() == []


def test_loop(reader: BagReader) -> None:
    player = Player(reader, 0, loop=True, rate=100.0)
    assert len(played(player, S // 2)) >= 3 * 177
    assert not player.finished


def test_topics(reader: BagReader) -> None:
    player = Player(reader, 0, topics=frozenset(["/demo/depth"]), rate=100.0)
    assert len(played(player, S)) == 44
    with pytest.raises(BagError, match="nothing to play"):
        Player(reader, 0, topics=frozenset(["/none"]))


def test_a_start_outside_the_bag_is_refused(reader: BagReader) -> None:
    with pytest.raises(BagError, match="outside"):
        Player(reader, 0, start_offset_s=99.0)
