"""The messages of a weld's bag by topic, without the weld's namespace, and their fields as columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fsw_analysis.columns import Column, Kind, MessageColumns
from fsw_analysis.set_points import HELD, SENT, SetPoint
from fsw_analysis.weld_signals import MM, FloatArray, IntArray, TextArray
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.topic import RecordedTopic

#: what a weld cannot do without one of, with its namespace before it
_OF_A_WELD = re.compile(r"^(.*)/fsw/(?:depth|spindle_torque|thermocouple|plant/truth|command)$")
#: of a copy of set-points, when the original was sent; older bags do not have it
_ISSUED = ("issued.sec", "issued.nanosec")
_STAMP: dict[str, Kind] = {"header.stamp.sec": "number", "header.stamp.nanosec": "number"}
_NS = 1_000_000_000


class Table:
    """Columns of one topic's messages, in order of receipt; damaged messages are left out.

    Attributes
    ----------
    log_ns, publish_ns, stamp_ns : IntArray
        Times of each message [ns]; the stamp is 0 where the type has none.
    """

    def __init__(
        self,
        topic: RecordedTopic,
        raw: list[tuple[int, int, bytes]],
        wanted: Mapping[str, Kind],
        problems: list[str],
    ) -> None:
        columns = MessageColumns(topic.type_name, topic.definition)
        missing = [path for path in wanted if not columns.has(path)]
        if set(missing) - set(_ISSUED):
            problems.append(f"{topic.name}: its type {topic.type_name} has no field {', '.join(missing)}")
        stamped = columns.has("header.stamp.sec")
        want = {path: kind for path, kind in wanted.items() if path not in missing}
        data, good = columns.extract([one[2] for one in raw], {**want, **(_STAMP if stamped else {})})
        if not good.all():
            problems.append(f"{topic.name}: {int((~good).sum())} of {good.size} messages are damaged and left out")
        times = np.array([one[:2] for one in raw], dtype=np.uint64).astype(np.int64)[good]
        self.log_ns: IntArray = times[:, 0]
        self.publish_ns: IntArray = times[:, 1]
        self.stamp_ns: IntArray = np.zeros(self.log_ns.size, dtype=np.int64)
        if stamped:
            seconds, nanoseconds = (data.pop(path)[good].astype(np.int64) for path in _STAMP)
            self.stamp_ns = seconds * _NS + nanoseconds
        self._columns = {path: values[good] for path, values in data.items()}

    def numbers(self, path: str, factor: float = 1.0) -> FloatArray:
        """Column of numbers; NaN when the type has no such field."""
        known = path in self._columns
        return np.asarray(self._columns[path] * factor) if known else np.full(self.log_ns.size, np.nan)

    def objects(self, path: str) -> Column:
        """Column of texts or sequences; empty texts when the type has no such field."""
        return self._columns[path] if path in self._columns else np.full(self.log_ns.size, "", dtype=object)

    def joined(self, path: str) -> TextArray:
        """Column of text sequences, each joined with a comma."""
        return np.array([",".join(one) for one in self.objects(path)], dtype=object)


class WeldMessages:
    """All messages of the one weld in a bag.

    Parameters
    ----------
    path : Path or str
        Bag folder or file, of any storage and state. The weld may have run in a namespace.
    wanted : collection of str, optional
        Read only these topics (names without namespace).
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

    def __init__(
        self,
        path: Path | str,
        wanted: Collection[str] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        raw: dict[str, list[tuple[int, int, bytes]]] = {}
        with BagReader(path) as reader:
            for record in reader.records(progress=progress):
                messages = raw.get(record.topic)
                if messages is None:
                    messages = raw[record.topic] = []
                data = b"" if record.topic.endswith("/prediction") else record.data
                messages.append((record.log_time_ns, record.publish_time_ns, data))
            topics = reader.topics()
            self.attachments = {one.name: one.data for one in reader.attachments()}
            self.problems = list(reader.problems)
        if not raw:
            raise BagError(f"{path}: the bag holds no messages" + "".join(f"; {one}" for one in self.problems))
        spaces = {match[1] for name in raw if (match := _OF_A_WELD.match(name))}
        if len(spaces) > 1 and "" not in spaces:
            several = ", ".join(sorted(spaces))
            raise BagError(f"{path}: holds several welds, in {several}: convert or record one of them")
        self.namespace = spaces.pop() if len(spaces) == 1 else ""
        self.topics = {name.removeprefix(self.namespace): topic for name, topic in topics.items()}
        named = {name.removeprefix(self.namespace): messages for name, messages in raw.items()}
        self.raw = {name: messages for name, messages in named.items() if wanted is None or name in wanted}

    def table(self, name: str, wanted: Mapping[str, Kind]) -> Table | None:
        """Columns of a topic; None when the bag has none of its messages, or none that can be read."""
        topic, raw = self.topics.get(name), self.raw.get(name)
        if topic is None or not raw:
            return None
        if topic.encoding != "cdr" or not topic.definition:
            self.problems.append(f"{name}: the bag holds no definition of {topic.type_name or 'its type'}; left out")
            return None
        try:
            table = Table(topic, raw, wanted, self.problems)
        except BagError as error:
            self.problems.append(f"{name}: {error}")
            return None
        return table if table.log_ns.size else None

    def set_points(self) -> tuple[list[SetPoint], list[SetPoint]]:
        """Set-points as sent, and as the supervisor said that they hold; in order of receipt."""
        wanted: dict[str, Kind] = dict.fromkeys(("depth", "temperature", *_ISSUED), "number")
        sent, held = (self.table(name, wanted) for name in (SENT, HELD))
        return _set_points(sent), _set_points(held)

    def parameters(self, controller: str) -> dict[str, Any]:
        """Parameters that a controller's node was recorded with.

        Raises
        ------
        BagError
            The bag does not have them, or they cannot be read.
        """
        return recorded_parameters(self.attachments, self.namespace, controller)


def recorded_parameters(attachments: Mapping[str, bytes], namespace: str, controller: str) -> dict[str, Any]:
    """Parameters of a controller's node among the attachments of a bag; see `WeldMessages.parameters`."""
    node = f"{namespace}/fsw_{controller}"
    data = attachments.get(f"parameters/{node.strip('/').replace('/', '.')}.yaml")
    if data is None:
        raise BagError(f"the bag has no parameters of {controller}")
    try:
        values = yaml.safe_load(data)[node]["ros__parameters"]
        return {str(key): value for key, value in values.items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, UnicodeDecodeError):
        raise BagError(f"the parameters of {controller} in the bag cannot be read") from None


def _set_points(table: Table | None) -> list[SetPoint]:
    if table is None:
        return []
    seconds, nanoseconds = (np.nan_to_num(table.numbers(path)).astype(np.int64) for path in _ISSUED)
    issued = seconds * _NS + nanoseconds
    issued = np.where(issued > 0, issued, table.publish_ns)
    columns = (table.log_ns, issued, table.stamp_ns, table.numbers("depth", MM), table.numbers("temperature"))
    rows = zip(*(values.tolist() for values in columns), strict=True)
    points = [SetPoint(*row) for row in rows]
    return [one for one in points if 0.0 < one.depth_mm < np.inf and 0.0 < one.temperature_c < np.inf]
