"""Repairs bags: copies everything that can be read into a new, whole bag."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fsw_recorder.bag_reader import FOREVER_NS, BagReader
from fsw_recorder.bag_writer import BagWriter, RecordedTopic, WriterOptions
from fsw_recorder.topic_selection import TopicSelection

_BATCH = 2000


@dataclass(frozen=True, slots=True)
class SalvageResult:
    """What was saved: number of messages and topics, and what was wrong with the bag."""

    messages: int
    topics: int
    problems: list[str]


def salvage(
    source: Path | str,
    target: Path,
    options: WriterOptions | None = None,
    progress: Callable[[float], None] | None = None,
    selection: TopicSelection | None = None,
    keep_attachment: Callable[[str], bool] = lambda _: True,
    stop_ns: int = FOREVER_NS,
) -> SalvageResult:
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
        topics = reader.topics()
        if selection is not None:
            topics = {name: topic for name, topic in topics.items() if selection.takes(name)}
        custom = dict(reader.metadata.custom_data) if reader.metadata else {}
        if reader.problems:
            custom["salvaged_from"] = str(source)
        count = 0
        with BagWriter(target, options, custom) as writer:
            for topic in topics.values():
                writer.add_topic(
                    RecordedTopic(
                        topic.name,
                        topic.type_name,
                        topic.schema_text,
                        topic.type_hash,
                        tuple(topic.qos),
                        topic.encoding,
                        topic.schema_encoding,
                    )
                )
            for attachment in reader.attachments():
                if keep_attachment(attachment.name):
                    writer.attach(attachment.name, attachment.media_type, attachment.data)
            for record in reader.records(topics, stop_ns=stop_ns, progress=progress):
                count += 1
                if count % _BATCH == 0:
                    _drain(writer)
                writer.write(record.topic, record.data, record.log_time_ns, record.publish_time_ns, record.sequence)
                if writer.error is not None:
                    break
        if writer.error is not None:
            raise writer.error
        return SalvageResult(count, sum(1 for topic in topics.values() if topic.count), list(reader.problems))


def _drain(writer: BagWriter) -> None:
    """Let the disk keep up, so that nothing is dropped however large the bag."""
    while writer.error is None and writer.statistics().pending_bytes > writer.options.max_pending_bytes // 4:
        time.sleep(0.001)
