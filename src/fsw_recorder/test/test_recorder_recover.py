"""Recovering copies everything that can be read, exactly."""

import errno
import os
import shutil
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from fsw_recorder import BagError
from fsw_recorder.bag_reader import BagReader, BagRecord
from fsw_recorder.bag_writer import WriterOptions
from fsw_recorder.recover import recover


def records_of(bag: Path) -> list[BagRecord]:
    with BagReader(bag) as reader:
        return list(reader.records())


def test_genuine_bags_are_copied_exactly(genuine_bag: Path, tmp_path: Path) -> None:
    target = tmp_path / "copy"
    result = recover(genuine_bag, target, WriterOptions(compression="zstd"))
    assert result.messages == 177 and result.topics == 5 and result.problems == []
    assert records_of(target) == records_of(genuine_bag)
    with BagReader(genuine_bag) as old, BagReader(target) as new:
        for name, topic in old.topics().items():
            copy = new.topics()[name]
            assert copy == topic
    with Reader(target) as reader:
        assert len(list(reader.messages())) == 177


@pytest.mark.parametrize("part", [0.2, 0.5, 0.8, 0.99])
def test_cut_weld(weld_bag: Path, tmp_path: Path, part: float) -> None:
    whole = records_of(weld_bag)
    content = (weld_bag / "weld_0.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: int(len(content) * part)])
    result = recover(cut, tmp_path / "saved")
    saved = records_of(tmp_path / "saved")
    assert result.problems and result.messages == len(saved) > 0
    assert saved == whole[: len(saved)]
    with BagReader(tmp_path / "saved") as reader:
        assert [attachment.name for attachment in reader.attachments()] == ["scenario.yaml"]
        assert reader.problems == []


def test_nothing_to_save(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"nothing")
    with pytest.raises(BagError, match=r"a\.mcap"):
        recover(tmp_path / "a.mcap", tmp_path / "saved")
    assert not (tmp_path / "saved").exists()


def test_target_exists(weld_bag: Path, tmp_path: Path) -> None:
    shutil.copytree(weld_bag, tmp_path / "saved")
    with pytest.raises(BagError, match="exists already"):
        recover(weld_bag, tmp_path / "saved")


def test_unfinished_bag_is_removed(
    weld_bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room, write = [5_000], os.write

    def fill(descriptor: int, data: bytes) -> int:
        room[0] -= len(data)
        if room[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(descriptor, data)

    with monkeypatch.context() as patch:
        patch.setattr("fsw_recorder.bag_file.os.write", fill)
        with pytest.raises(BagError):
            recover(weld_bag, tmp_path / "saved")
    assert not (tmp_path / "saved").exists()

    def interrupt(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recover(weld_bag, tmp_path / "saved", progress=interrupt)
    assert not (tmp_path / "saved").exists()
