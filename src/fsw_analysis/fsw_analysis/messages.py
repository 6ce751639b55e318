"""The messages of a weld's bag by topic, without the weld's namespace, and their fields as columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fsw_analysis.columns import Column, Kind, MessageColumns
from fsw_analysis.weld_signals import IntArray
from fsw_control.units import NANOSECONDS
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError

#: topic and field of each of `fsw_control.contract.SENSORS`
SENSOR_FIELDS = {
    "depth": ("/fsw/depth", "depth"),
    "torque": ("/fsw/spindle_torque", "torque"),
    "thermocouple": ("/fsw/thermocouple", "temperature"),
}
_STAMP: dict[str, Kind] = {"header.stamp.sec": "number", "header.stamp.nanosec": "number"}
#: what a weld cannot do without one of, with its namespace before it
_OF_A_WELD = re.compile(r"(.*)/fsw/(?:depth|spindle_torque|thermocouple|plant/truth|command)")


class Table:
    """Columns of one topic's messages, in order of receipt; damaged messages are left out.

    Attributes
    ----------
    log_ns, publish_ns, stamp_ns : IntArray
        Times of each message [ns]; the stamp is 0 where the type has none.
    """

    def __init__(self, times: IntArray, columns: dict[str, Column]) -> None:
        self.log_ns, self.publish_ns = times.T
        self._columns = columns
        self.stamp_ns = self.time_ns(*_STAMP) if columns.keys() >= _STAMP.keys() else np.zeros_like(self.log_ns)

    def __len__(self) -> int:
        """Number of messages."""
        return int(self.log_ns.size)

    def column(self, path: str) -> Column:
        """Values of a field, as in `MessageColumns.extract`."""
        return self._columns[path]

    def time_ns(self, seconds: str, nanoseconds: str) -> IntArray:
        """Time in two fields [ns]; 0 where the type has none."""
        whole, rest = (np.nan_to_num(self._columns[path]).astype(np.int64) for path in (seconds, nanoseconds))
        return whole * NANOSECONDS + rest


class WeldMessages:
    """All messages of the one weld in a bag.

    Parameters
    ----------
    path : Path or str
        Bag folder or file, of any storage and state. The weld may have run in a namespace.
    progress : callable, optional
        Called now and then with the fraction done, 0 to 1.

    Attributes
    ----------
    namespace : str
        In which the weld ran; empty or e.g. ``/hall/cell1``.
    topics : dict of str to RecordedTopic
    raw : dict of str to list of (int, int, bytes)
        Log time, publish time and data of every message of a topic; both by name without namespace.
    attachments : dict of str to bytes
    problems : list of str

    Raises
    ------
    BagError
        There is no bag, it cannot be read, it is empty, or it holds several welds in namespaces.
    """

    def __init__(self, path: Path | str, progress: Callable[[float], None] | None = None) -> None:
        raw: dict[str, list[tuple[int, int, bytes]]] = {}
        with BagReader(path) as reader:
            for record in reader.records(progress=progress):
                # predictions are only counted
                data = b"" if record.topic.endswith("/prediction") else record.data
                raw.setdefault(record.topic, []).append((record.log_time_ns, record.publish_time_ns, data))
            topics = reader.topics()
            self.attachments = {one.name: one.data for one in reader.attachments()}
            self.problems = list(reader.problems)
        if not raw:
            raise BagError("; ".join([f"{path}: the bag holds no messages", *self.problems]))
        spaces = {match[1] for name in raw if (match := _OF_A_WELD.fullmatch(name))}
        if len(spaces) > 1 and "" not in spaces:
            several = ", ".join(sorted(spaces))
            raise BagError(f"{path}: holds several welds, in {several}: convert or record one of them")
        self.namespace = spaces.pop() if len(spaces) == 1 else ""
        self.topics = {name.removeprefix(self.namespace): topic for name, topic in topics.items()}
        self.raw = {name.removeprefix(self.namespace): messages for name, messages in raw.items()}

    def controllers(self, what: str) -> dict[str, str]:
        """Topics on which controllers tell something (``proposal`` or ``status``), by the controller's name."""
        topic = re.compile(rf"/fsw/([^/]+)/{what}")
        return {match[1]: name for name in sorted(self.raw) if (match := topic.fullmatch(name))}

    def table(self, name: str, wanted: Mapping[str, Kind]) -> Table:
        """Columns of a topic; empty when the bag has none of its messages, or none that can be read."""
        topic, raw = self.topics.get(name), self.raw.get(name)
        nothing = {path: np.empty(0, float if kind == "number" else object) for path, kind in wanted.items()}
        empty = Table(np.empty((0, 2), np.int64), nothing)
        if topic is None or not raw:
            return empty
        try:
            if topic.encoding != "cdr" or not topic.definition:
                raise BagError(f"the bag holds no definition of {topic.type_name or 'its type'}; left out")
            columns = MessageColumns(topic.type_name, topic.definition)
        except BagError as error:
            self.problems.append(f"{name}: {error}")
            return empty
        missing = [path for path in wanted if not columns.has(path)]
        if missing:
            self.problems.append(f"{topic.name}: its type {topic.type_name} has no field {', '.join(missing)}")
        data, good = columns.extract([one[2] for one in raw], {**wanted, **_STAMP})
        if not good.all():
            self.problems.append(f"{topic.name}: {int((~good).sum())} of {good.size} messages are damaged and left out")
        times = np.array([one[:2] for one in raw], dtype=np.uint64).astype(np.int64)
        return Table(times[good], {path: values[good] for path, values in data.items()})


def recorded_parameters(attachments: Mapping[str, bytes], namespace: str, controller: str) -> dict[str, Any]:
    """Parameters that a controller's node was recorded with, among the attachments of a bag.

    Raises
    ------
    BagError
        The bag does not have them, or they cannot be read.
    """
    node = f"{namespace}/fsw_{controller}"
    data = attachments.get(f"parameters/{node.strip('/').replace('/', '.')}.yaml")
    if data is None:
        raise BagError(f"the bag has no parameters of {controller}")
    try:
        values = yaml.safe_load(data)[node]["ros__parameters"]
        return {str(key): value for key, value in values.items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, UnicodeDecodeError):
        raise BagError(f"the parameters of {controller} in the bag cannot be read") from None
