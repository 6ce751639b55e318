"""A recorder that is killed at any moment loses at most the last second."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from fsw_recorder.bag_reader import BagReader
from fsw_recorder.recover import recover

WRITER = """
import struct, sys, time
from pathlib import Path
from fsw_recorder.bag_writer import BagWriter, RecordedTopic, WriterOptions

writer = BagWriter(Path(sys.argv[1]), WriterOptions(compression=sys.argv[2]))
writer.add_topic(RecordedTopic("/x", "std_msgs/msg/Float64", "float64 data\\n"))
index = 0
while True:
    now = time.time_ns()
    writer.write("/x", b"\\0\\1\\0\\0" + struct.pack("<d", index), now, now, index)
    index += 1
    if index % 10 == 0:
        print(index, now, flush=True)
    time.sleep(0.001)
"""


@pytest.mark.parametrize(("compression", "after_s"), [("", 0.73), ("zstd", 1.1)])
def test_kill_minus_nine(tmp_path: Path, compression: str, after_s: float) -> None:
    bag = tmp_path / "bag"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(bag), compression],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert process.stdout is not None
    started = None
    last = (0, 0)
    for line in process.stdout:
        index, stamp = line.split()
        last = int(index), int(stamp)
        started = started or time.monotonic()
        if time.monotonic() - started > after_s:
            process.send_signal(signal.SIGKILL)
            break
    last = max([last, *((int(line.split()[0]), int(line.split()[1])) for line in process.stdout if " " in line)])
    assert process.wait(10.0) == -signal.SIGKILL
    assert not (bag / "metadata.yaml").exists()

    with BagReader(bag) as reader:
        records = list(reader.records())
        assert any("not finished" in problem for problem in reader.problems)
    assert [record.sequence for record in records] == list(range(len(records)))
    assert last[1] - records[-1].log_time_ns < 1_000_000_000

    result = recover(bag, tmp_path / "saved")
    assert result.messages == len(records)
    with Reader(tmp_path / "saved") as saved:
        assert [(time_ns, bytes(data)) for _, time_ns, data in saved.messages()] == [
            (record.log_time_ns, record.data) for record in records
        ]
