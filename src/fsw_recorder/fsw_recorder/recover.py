"""Makes an intact bag of all that is readable in another."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fsw_recorder.bag_reader import FOREVER_NS, BagReader, BagRecord
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_recorder.errors import BagError
from fsw_recorder.topic import TopicSelection

#: data passed to the writer between waits for the disk, plus this much for every message
_BATCH_BYTES, _MESSAGE_BYTES = 16 * 1024 * 1024, 1000
#: time limit for writing them
_PATIENCE_S = 600.0


@dataclass(frozen=True, slots=True)
class Recovery:
    """Result: numbers of copied messages and topics, and problems of the bag."""

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

    Topics, types, definitions, QoS, times, sequence numbers and bytes are kept; this also converts
    any readable bag (split, compressed, sqlite3) into an MCAP bag. The new folder must not exist.
    ``selection``, ``keep_attachment`` and ``stop_ns`` restrict it to topics, to attachments by
    name, and to messages received before a time. ``progress`` is called now and then with the
    fraction done, 0 to 1. If it cannot be finished, nothing is left of the new bag: a part would
    look like the whole.

    Raises
    ------
    BagError
        If nothing can be read, or the new bag cannot be written.
    """
    with BagReader(source) as reader:
        topics = {
            name: topic
            for name, topic in reader.topics().items()
            if selection is None or selection.takes(name)
        }
        custom = {**reader.metadata.custom_data, "recovered_from": str(source)}
        writer = BagWriter(target, options, custom)
        try:
            with writer:
                for topic in topics.values():
                    writer.add_topic(topic)
                for attachment in reader.attachments():
                    if keep_attachment(attachment.name):
                        writer.attach(attachment.name, attachment.media_type, attachment.data)
                records = reader.records(topics, stop_ns=stop_ns, progress=progress)
                return copy(records, writer, reader.problems)
        except BaseException:  # an interrupt, too
            shutil.rmtree(writer.folder, ignore_errors=True)
            raise


def copy(
    records: Iterable[BagRecord], writer: BagWriter, problems: Sequence[str] = ()
) -> Recovery:
    """Write records to a bag at the speed of the disk and close it; a `BagError` if incomplete."""
    topics: set[str] = set()
    waiting = 0
    for record in records:
        topics.add(record.topic)
        waiting += len(record.data) + _MESSAGE_BYTES
        if waiting > _BATCH_BYTES:
            waiting = 0
            writer.flush(_PATIENCE_S)
        if not writer.write(
            record.topic, record.data, record.log_time_ns, record.publish_time_ns, record.sequence
        ):
            break
    writer.close()
    if writer.error is not None:
        raise writer.error
    written = writer.statistics()
    if written["dropped"]:
        raise BagError(
            f"{writer.folder}: incomplete: the disk did not accept a message of {record.topic}"
        )
    return Recovery(written["written"], len(topics), list(problems))
