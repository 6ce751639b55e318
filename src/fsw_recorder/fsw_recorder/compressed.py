"""Files that rosbag2 has compressed as a whole."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import zstandard
from mcap.writer import MCAP0_MAGIC

from fsw_control.schema.files import open_regular

SUFFIX = ".zstd"
#: magic bytes of sqlite3 and MCAP files
_BEGINNINGS = (b"SQLite format 3\0", MCAP0_MAGIC)


@contextmanager
def decompressed(path: Path) -> Iterator[Path]:
    """Yield a decompressed copy of a file, or the file itself if its name lacks ``.zstd``.

    A damaged or truncated file is decompressed up to that point; the reader of the copy finds out
    what is missing.
    """
    if path.suffix != SUFFIX:
        yield path
        return
    with TemporaryDirectory(prefix="fsw_bag_") as folder:
        copy = Path(folder) / path.stem
        decompressor = zstandard.ZstdDecompressor(max_window_size=2**27)
        with open_regular(path) as source, copy.open("wb") as target:
            try:
                content = decompressor.stream_reader(source, read_across_frames=True)
                head = content.read(len(_BEGINNINGS[0]))
                target.write(head)
                if head.startswith(_BEGINNINGS):  # anything else may be huge, and is not a bag
                    shutil.copyfileobj(content, target)
            except zstandard.ZstdError:
                pass
        yield copy
