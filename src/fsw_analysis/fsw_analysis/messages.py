"""Messages of a weld's bag by topic without namespace, with their fields as columns."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from numbers import Real
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from fsw_analysis.weld_signals import IntArray
from fsw_control.sensors import SENSORS
from fsw_control.units import NANOSECONDS
from fsw_recorder.bag_reader import UNKNOWN_NS, BagReader
from fsw_recorder.definitions import Definitions, definition_of
from fsw_recorder.errors import BagError
from fsw_recorder.weld_clock import stamp_ns

Kind = Literal["number", "text", "numbers", "texts"]
#: per kind float64 (n,), and object (n,) of str, of float64 arrays and of lists of str
Column = npt.NDArray[Any]

#: by kind of field, its decoded type and the value for types without the field
_KINDS: dict[Kind, tuple[type, Any]] = {
    "number": (Real, np.nan),
    "text": (str, ""),
    "numbers": (np.ndarray, np.empty(0)),
    "texts": (list, []),
}
#: fields of the depth that say what it is fused from
_FUSED: dict[str, Kind] = {
    "standard_deviation": "number",
    "channel_health": "numbers",
    "channels_used": "number",
    "footprint_bias": "number",
    "footprint": "text",
}
#: by sensor
SENSOR_TOPICS = {name: f"/{row.topic}" for name, row in SENSORS.items()}
#: topics by which a weld is recognised, after its namespace
_OF_A_WELD = re.compile(
    rf"(.*)(?:{'|'.join(SENSOR_TOPICS.values())}|/fsw/plant/truth|/fsw/command)"
)


class Table:
    """Columns of one topic's messages, in order of receipt; damaged messages are left out."""

    def __init__(self, times: Sequence[tuple[int, int, int]], columns: dict[str, Column]) -> None:
        log_ns, publish_ns, stamp_ns = zip(*times, strict=True) if times else ((), (), ())
        #: times of each message [ns]; the stamp is 0 where the type has none
        self.log_ns, self.publish_ns = (
            np.array(stamps, np.uint64).astype(np.int64) for stamps in (log_ns, publish_ns)
        )
        self.stamp_ns: IntArray = np.array(stamp_ns, np.int64)
        self._columns = columns

    def __len__(self) -> int:
        """Number of messages."""
        return int(self.log_ns.size)

    def column(self, path: str) -> Column:
        """Values of a field."""
        return self._columns[path]

    def without_repetitions(self) -> Table:
        """First of consecutive messages with the same stamp."""
        rows = np.flatnonzero(np.diff(self.stamp_ns, prepend=-1))
        times = np.column_stack((self.log_ns, self.publish_ns, self.stamp_ns))[rows]
        return Table(
            times.tolist(), {path: column[rows] for path, column in self._columns.items()}
        )


class WeldMessages:
    """All messages of the one weld in a bag.

    Parameters
    ----------
    path : Path or str
        Bag folder or file, of any storage and state. The weld may have run in a namespace.
    progress : callable, optional
        Called now and then with the fraction done, 0 to 1.

    Raises
    ------
    BagError
        There is no bag, it cannot be read, it is empty, or it holds several welds in namespaces.
    """

    def __init__(self, path: Path | str, progress: Callable[[float], None] | None = None) -> None:
        self.path = Path(path)
        raw: dict[str, list[tuple[int, int, bytes]]] = {}
        others: Counter[str] = Counter()
        known: set[int] = set()
        repeated = untimed = 0
        with BagReader(path) as reader:
            first = reader.topics()
            for record in reader.records(progress=progress):
                if record.topic in first and record.type_name != first[record.topic].type_name:
                    others[record.topic] += 1
                    continue
                key = hash((record.topic, record.publish_time_ns, record.data))
                if key in known:
                    repeated += 1
                    continue
                known.add(key)
                log_ns = record.log_time_ns
                if log_ns in UNKNOWN_NS:
                    untimed += 1
                    log_ns = record.publish_time_ns
                # predictions are only counted
                data = b"" if record.topic.endswith("/prediction") else record.data
                raw.setdefault(record.topic, []).append((log_ns, record.publish_time_ns, data))
            topics = reader.topics()
            self.attachments = {item.name: item.data for item in reader.attachments()}
            self.custom = dict(reader.metadata.custom_data)
            self.problems = list(reader.problems)
        for name, count in others.items():
            self.problems.append(
                f"{name}: {count} messages of another type than "
                f"{topics[name].type_name} are left out"
            )
        if repeated:
            self.problems.append(f"{path}: {repeated} messages are in the bag again and left out")
        if untimed:
            self.problems.append(
                f"{path}: {untimed} messages have no receive time; "
                "their publish time stands for it"
            )
        self._definitions = Definitions()
        if not raw:
            raise BagError("; ".join([f"{path}: the bag holds no messages", *self.problems]))
        spaces = {match[1] for name in raw if (match := _OF_A_WELD.fullmatch(name))}
        if len(spaces) > 1 and "" not in spaces:
            several = ", ".join(sorted(spaces))
            raise BagError(
                f"{path}: holds several welds, in {several}: convert or record one of them"
            )
        #: namespace of the weld, e.g. ``/hall/cell1``; the names of topics are without it
        self.namespace = spaces.pop() if len(spaces) == 1 else ""
        self.topics = {name.removeprefix(self.namespace): topic for name, topic in topics.items()}
        #: log time, publish time and data of every message of a topic
        self.raw = {name.removeprefix(self.namespace): messages for name, messages in raw.items()}
        self._order()

    def _order(self) -> None:
        """Order each topic's messages by receive time or, if that is wrong, publish time."""
        for messages in self.raw.values():
            messages.sort(key=itemgetter(0))
        sensors = [self.raw.get(topic, []) for topic in SENSOR_TOPICS.values()]
        wrong = any(map(_simultaneous, sensors))
        if not wrong and any(
            map(_goes_back, sensors)
        ):  # else the plant was started again, if these go back, too
            wrong = not any(
                _goes_back(sorted(messages, key=itemgetter(1))) for messages in sensors
            )
        if wrong:
            self.problems.append(
                f"{self.path}: the receive times are wrong; the publish times stand for them"
            )
            for messages in self.raw.values():
                messages[:] = [(publish_ns, publish_ns, data) for _, publish_ns, data in messages]
                messages.sort(key=itemgetter(0))

    def controllers(self, kind: str) -> dict[str, str]:
        """Topics of ``proposal`` or ``status`` messages, by the controller's name."""
        topic = re.compile(rf"/fsw/([^/]+)/{kind}")
        return {match[1]: name for name in sorted(self.raw) if (match := topic.fullmatch(name))}

    def decoded(self, name: str) -> Iterator[tuple[int, int, Any]]:
        """Log time, publish time and message of a topic's intact messages; see `problems`."""
        topic, raw = self.topics.get(name), self.raw.get(name)
        if topic is None or not raw:
            return
        try:
            definition = definition_of(topic)
            self._definitions.typestore(topic.type_name, definition)
        except BagError as error:
            self.problems.append(f"{name}: {error}; left out")
            return
        damaged = 0
        for log_ns, publish_ns, data in raw:
            try:
                message = self._definitions.decode(topic.type_name, definition, data)
            except BagError:
                damaged += 1
            else:
                yield log_ns, publish_ns, message
        if damaged:
            self.problems.append(
                f"{topic.name}: {damaged} of {len(raw)} messages are damaged and left out"
            )

    def sensors(self) -> dict[str, tuple[Table, Column]]:
        """Messages of each sensor, with its values in the unit inside."""
        sensors = {}
        for name, row in SENSORS.items():
            field, fused = row.quantity.name, _FUSED if name == "depth" else None
            table = self.table(SENSOR_TOPICS[name], {field: "number"}, fused)
            sensors[name] = (table, row.inside(table.column(field)))
        return sensors

    def table(
        self, name: str, wanted: Mapping[str, Kind], optional: Mapping[str, Kind] | None = None
    ) -> Table:
        """Columns of a topic by paths of fields; empty without readable messages.

        NaN or empty values stand for a field that its type lacks, which is reported as a
        problem unless the field is ``optional``: of other versions of the messages.
        """
        kinds = {**wanted, **(optional or {})}
        times: list[tuple[int, int, int]] = []
        values: dict[str, list[Any]] = {}
        getters: list[tuple[list[Any], Any]] = []
        for log_ns, publish_ns, message in self.decoded(name):
            if not times:
                values = {path: [] for path, kind in kinds.items() if _has(message, path, kind)}
                getters = [(column, attrgetter(path)) for path, column in values.items()]
            times.append((log_ns, publish_ns, stamp_of(message)))
            for column, get in getters:
                column.append(get(message))
        if missing := [path for path in wanted if times and path not in values]:
            topic = self.topics[name]
            self.problems.append(
                f"{topic.name}: its type {topic.type_name} has no field {', '.join(missing)}"
            )
        columns = {}
        for path, kind in kinds.items():
            read = values.get(path, [_KINDS[kind][1]] * len(times))
            columns[path] = np.fromiter(read, float if kind == "number" else object, len(times))
        return Table(times, columns)


def _goes_back(messages: Sequence[tuple[int, int, bytes]]) -> bool:
    """Whether the stamps of a node's messages decrease."""
    stamps = [stamp_ns(data) or 0 for _, _, data in messages]
    return any(after < before for before, after in pairwise(stamps))


def _simultaneous(messages: Sequence[tuple[int, int, bytes]]) -> bool:
    """Whether consecutive messages of one node were received at the same time."""
    return any(a[0] == b[0] and a[1] != b[1] for a, b in pairwise(messages))


def _has(message: Any, path: str, kind: Kind) -> bool:
    try:
        return isinstance(attrgetter(path)(message), _KINDS[kind][0])
    except AttributeError:
        return False


def stamp_of(message: Any) -> int:
    """Stamp of a decoded message [ns]; 0 if its type has none."""
    try:
        stamp = message.header.stamp
        return int(stamp.sec * NANOSECONDS + stamp.nanosec)
    except AttributeError:
        return 0
