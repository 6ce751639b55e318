"""A recorder that is killed at any moment loses nothing that is on file.

That this is all but the last second at most, is tested with the node.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from fsw_recorder.bag_reader import BagReader
from fsw_recorder.recover import recover

pytestmark = pytest.mark.slow

#: messages without a commit before the writer is killed
WAITING = 100
WRITER = """
import select, struct, sys, time
from pathlib import Path
from fsw_recorder.bag_writer import BagWriter, RecordedTopic, WriterOptions

writer = BagWriter(Path(sys.argv[1]), WriterOptions(compression=sys.argv[2]))
writer.add_topic(RecordedTopic("/x", "std_msgs/msg/Float64", "float64 data\\n"))
index = 0
while not select.select([sys.stdin], [], [], 0.001)[0]:  # until the test ends, a thousand times a second
    now = time.time_ns()
    writer.write("/x", b"\\0\\1\\0\\0" + struct.pack("<d", index), now, now, index)
    index += 1
    if index % 10 == 0:
        print(index, flush=True)
"""


@pytest.mark.requirement("S22")
@pytest.mark.parametrize(("compression", "commits"), [("", 2), ("zstd", 3)])
def test_kill_minus_nine(tmp_path: Path, compression: str, commits: int) -> None:
    """The writer is killed when some messages wait for the next commit, however busy the machine."""
    bag = tmp_path / "bag"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(bag), compression],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert process.stdout is not None
    grown_at: dict[int, int] = {}
    for line in process.stdout:
        index = int(line)
        committed = grown_at.setdefault((bag / "bag_0.mcap").stat().st_size, index)
        if len(grown_at) > commits and index - committed >= WAITING:
            with BagReader(bag) as reader:
                on_file = len(list(reader.records()))
            process.send_signal(signal.SIGKILL)
            break
    process.stdout.read()
    assert process.wait(240.0) == -signal.SIGKILL
    assert not (bag / "metadata.yaml").exists()

    with BagReader(bag) as reader:
        records = list(reader.records())
        assert any("not finished" in problem for problem in reader.problems)
    assert [record.sequence for record in records] == list(range(len(records)))
    assert len(records) >= on_file > 0

    result = recover(bag, tmp_path / "saved")
    assert result.messages == len(records)
    with Reader(tmp_path / "saved") as saved:
        assert [(time_ns, bytes(data)) for _, time_ns, data in saved.messages()] == [
            (record.log_time_ns, record.data) for record in records
        ]
