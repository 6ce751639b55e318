"""Makes a whole bag of whatever can be read of another."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fsw_recorder.bag_reader import FOREVER_NS, BagReader
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_recorder.topic import TopicSelection

#: how often, in messages, the writer is given time to keep up
_BATCH = 2000


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was copied: number of messages and topics; and what was wrong with the bag."""

    messages: int
    topics: int
    problems: list[str]


def recover(
    source: Path | str,
    target: Path,
    options: WriterOptions | None = None,
    progress: Callable[[float], None] | None = None,
    selection: TopicSelection | None = None,
    keep_attachment: Callable[[str], bool] = lambda _: True,
    stop_ns: int = FOREVER_NS,
) -> Recovery:
    """Copy all readable messages and attachments of a bag into a new bag.

    Topics, types, definitions, QoS, times, sequence numbers and bytes stay as they are; also turns any readable bag
    (split, compressed, sqlite3) into one MCAP bag.

    Parameters
    ----------
    source : Path or str
        Bag folder or file in any state.
    target : Path
        Folder of the new bag; must not exist.
    options : WriterOptions, optional
        How it is written.
    progress : callable, optional
        Called now and then with the fraction done, 0 to 1.
    selection : TopicSelection, optional
        Topics to copy; all by default.
    keep_attachment : callable, optional
        Says by name which attachments are copied; all by default.
    stop_ns : int
        Only messages received before.

    Raises
    ------
    BagError
        Nothing can be read, or the new bag cannot be written.
    """
    with BagReader(source) as reader:
        topics = {name: topic for name, topic in reader.topics().items() if selection is None or selection.takes(name)}
        custom = dict(reader.metadata.custom_data)
        if reader.problems:
            custom["recovered_from"] = str(source)
        count = 0
        with BagWriter(target, options, custom) as writer:
            for topic in topics.values():
                writer.add_topic(topic)
            for attachment in reader.attachments():
                if keep_attachment(attachment.name):
                    writer.attach(attachment.name, attachment.media_type, attachment.data)
            for record in reader.records(topics, stop_ns=stop_ns, progress=progress):
                count += 1
                if count % _BATCH == 0:
                    _wait_for_disk(writer)
                writer.write(record.topic, record.data, record.log_time_ns, record.publish_time_ns, record.sequence)
                if writer.error is not None:
                    break
        if writer.error is not None:
            raise writer.error
        copied = sum(1 for name in topics if reader.counts().get(name))
        return Recovery(count, copied, list(reader.problems))


def _wait_for_disk(writer: BagWriter) -> None:
    """Let the disk keep up, so that nothing is dropped however large the bag."""
    while writer.error is None and writer.statistics().pending_bytes > writer.options.max_pending_bytes // 4:
        time.sleep(0.001)
