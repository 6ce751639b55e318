"""Turns the bag of a weld into aligned arrays in the paper's units."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_recorder.bag_reader import BagReader, TopicInfo
from fsw_recorder.cdr_columns import CdrColumns, Column, Kind
from fsw_recorder.errors import BagError
from fsw_recorder.weld_events import diagnostic_events, held_events, text_events, truth_events
from fsw_recorder.weld_signals import (
    REFERENCE_TOPICS,
    FloatArray,
    IntArray,
    ProposalSignals,
    StatusSignals,
    TextArray,
    TruthSignals,
    WeldEvent,
    WeldSignals,
)

RPM_PER_RAD_S = 1.0 / RAD_PER_S_PER_RPM
#: a stamp further than this from the ticks around it comes from another clock, as `ReferenceQueue` sees it
_OTHER_CLOCK_S = 36_000.0
#: name of the field: topic, factor to the paper's unit
_SENSORS = {
    "depth": ("/fsw/depth", 1e3),
    "torque": ("/fsw/spindle_torque", 1.0),
    "temperature": ("/fsw/thermocouple", 1.0),
}
_PROPOSAL = re.compile(r"^/fsw/([^/]+)/proposal$")
_STATUS = re.compile(r"^/fsw/([^/]+)/status$")
#: field of the truth: field of the message, factor to the paper's unit
_TRUTH = {
    "depth_mm": ("depth", 1e3),
    "temperature_c": ("temperature", 1.0),
    "motor_torque_nm": ("motor_torque", 1.0),
    "process_torque_nm": ("process_torque", 1.0),
    "friction_torque_nm": ("friction_torque", 1.0),
    "process_power_kw": ("process_power", 1e-3),
    "force_kn": ("axial_force", 1e-3),
    "speed_rpm": ("spindle_speed", RPM_PER_RAD_S),
    "depth_disturbance_mm": ("depth_disturbance", 1e3),
    "temperature_disturbance_c": ("temperature_disturbance", 1.0),
    "force_disturbance_kn": ("force_disturbance", 1e-3),
    "speed_disturbance_rpm": ("speed_disturbance", RPM_PER_RAD_S),
    "watchdog": ("watchdog", 1.0),
    "refused_commands": ("refused_commands", 1.0),
}
_STATUS_NUMBERS = {
    "depth_estimate_mm": ("depth_estimate", 1e3),
    "temperature_estimate_c": ("temperature_estimate", 1.0),
    "torque_estimate_nm": ("torque_estimate", 1.0),
    "healthy": ("healthy", 1.0),
    "selected": ("selected", 1.0),
    "solve_time_s": ("solve_time", 1.0),
    "iterations": ("iterations", 1.0),
    "bad_cycles": ("bad_cycles", 1.0),
}
_COMMAND: dict[str, Kind] = {
    "axial_force": "number",
    "spindle_speed": "number",
    "healthy": "number",
    "source": "text",
    "reason": "text",
}
#: what a weld cannot do without one of, with its namespace before it
_OF_A_WELD = re.compile(r"^(.*)/fsw/(?:depth|spindle_torque|thermocouple|plant/truth|command)$")
_STAMP: dict[str, Kind] = {"header.stamp.sec": "number", "header.stamp.nanosec": "number"}


class _Topic:
    """Columns of one topic's messages, in order of receipt; damaged messages are left out."""

    def __init__(
        self, info: TopicInfo, raw: list[tuple[int, bytes]], wanted: Mapping[str, Kind], problems: list[str]
    ) -> None:
        columns = CdrColumns(info.type_name, info.schema_text)
        missing = [path for path in wanted if not columns.has(path)]
        if missing:
            problems.append(f"{info.name}: its type {info.type_name} has no field {', '.join(missing)}")
        stamped = columns.has("header.stamp.sec")
        want = {path: kind for path, kind in wanted.items() if path not in missing}
        data, good = columns.extract([one[1] for one in raw], {**want, **(_STAMP if stamped else {})})
        if not good.all():
            problems.append(f"{info.name}: {int((~good).sum())} of {good.size} messages are damaged and left out")
        self.log_ns: IntArray = np.array([one[0] for one in raw], dtype=np.uint64).astype(np.int64)[good]
        self.stamp_ns: IntArray = np.zeros(self.log_ns.size, dtype=np.int64)
        if stamped:
            seconds, nanoseconds = data.pop("header.stamp.sec")[good], data.pop("header.stamp.nanosec")[good]
            self.stamp_ns = seconds.astype(np.int64) * 1_000_000_000 + nanoseconds.astype(np.int64)
        self._columns = {path: column[good] for path, column in data.items()}
        self._size = int(good.sum())

    def numbers(self, path: str, factor: float = 1.0) -> FloatArray:
        """Column of numbers; NaN when the type has no such field."""
        return np.asarray(self._columns[path] * factor) if path in self._columns else np.full(self._size, np.nan)

    def objects(self, path: str) -> Column:
        """Column of texts or sequences; empty texts when the type has no such field."""
        return self._columns[path] if path in self._columns else np.full(self._size, "", dtype=object)

    def joined(self, path: str) -> TextArray:
        """Column of text sequences, each joined with a comma."""
        return np.array([",".join(one) for one in self.objects(path)], dtype=object)


class _Ticks:
    """The plant's ticks: aligns everything else on them."""

    def __init__(self, sources: list[_Topic]) -> None:
        stamps = np.concatenate([one.stamp_ns for one in sources])
        logs = np.concatenate([one.log_ns for one in sources])
        self.stamp_ns: IntArray = np.unique(stamps)
        rows = np.searchsorted(self.stamp_ns, stamps)
        self.log_ns: IntArray = np.full(self.stamp_ns.size, np.iinfo(np.int64).max, dtype=np.int64)
        np.minimum.at(self.log_ns, rows, logs)
        self.time_s: FloatArray = (self.stamp_ns - self.stamp_ns[0]) * 1e-9

    def rows(self, topic: _Topic, first_wins: bool = False) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Row of the tick, and index of the message, for messages whose stamp is a tick's; one message per tick."""
        at = np.minimum(np.searchsorted(self.stamp_ns, topic.stamp_ns), self.stamp_ns.size - 1)
        index = np.flatnonzero(self.stamp_ns[at] == topic.stamp_ns)
        if first_wins:
            index = index[::-1]
        last = np.full(self.stamp_ns.size, -1, dtype=np.int64)
        last[at[index]] = index
        rows = np.flatnonzero(last >= 0)
        return rows, last[rows]

    def number(self, topic: _Topic, values: FloatArray, first_wins: bool = False) -> FloatArray:
        """Values at the ticks, NaN where there is none."""
        rows, index = self.rows(topic, first_wins)
        result = np.full(self.stamp_ns.size, np.nan)
        result[rows] = values[index]
        return result

    def text(self, topic: _Topic, values: TextArray) -> TextArray:
        """Texts at the ticks, empty where there is none."""
        rows, index = self.rows(topic)
        result = np.full(self.stamp_ns.size, "", dtype=object)
        result[rows] = values[index]
        return result

    def latency(self, topic: _Topic) -> FloatArray:
        """From the first recorded measurement of the tick to the recorded message [s]."""
        rows, index = self.rows(topic)
        result = np.full(self.stamp_ns.size, np.nan)
        result[rows] = (topic.log_ns[index] - self.log_ns[rows]) * 1e-9
        return result

    def times(self, topic: _Topic) -> FloatArray:
        """Seconds since the first tick: by stamp, and by receipt where the stamp is zero or of another clock."""
        by_stamp = (topic.stamp_ns - self.stamp_ns[0]) * 1e-9
        order = np.argsort(self.log_ns, kind="stable")
        at = np.clip(np.searchsorted(self.log_ns[order], topic.log_ns, side="right") - 1, 0, order.size - 1)
        by_receipt = self.time_s[order[at]]
        return np.where((topic.stamp_ns == 0) | (np.abs(by_stamp - by_receipt) > _OTHER_CLOCK_S), by_receipt, by_stamp)

    def held(self, topic: _Topic) -> npt.NDArray[np.int64]:
        """Index of the message in force at every tick; -1 before the first."""
        times = self.times(topic)
        order = np.argsort(times, kind="stable")
        at = np.searchsorted(times[order], self.time_s, side="right") - 1
        return np.where(at >= 0, order[np.maximum(at, 0)], -1)


def load_weld(path: Path | str, progress: Callable[[float], None] | None = None) -> WeldSignals:
    """Read the bag of a weld into aligned arrays.

    Parameters
    ----------
    path : Path or str
        Bag folder or file, of any storage; an unfinished or damaged one is read as far as possible. The weld may have
        run in a namespace.
    progress : callable, optional
        Called now and then with the fraction done, 0 to 1.

    Returns
    -------
    WeldSignals
        Aligned on the stamps of the sensor topics; in mm, degC, N m, kN, rpm, kW, s.

    Raises
    ------
    BagError
        There is no bag, it cannot be read, or it holds no weld, or several in namespaces.
    """
    with BagReader(path) as reader:
        raw: dict[str, list[tuple[int, bytes]]] = {}
        report = (lambda done: progress(0.8 * done)) if progress is not None else None
        for record in reader.records(progress=report):
            messages = raw.get(record.topic)
            if messages is None:
                messages = raw[record.topic] = []
            messages.append((record.log_time_ns, b"" if record.topic.endswith("/prediction") else record.data))
        infos = {one.name: one for one in reader.known_topics()}
        attachments = {one.name: one.data for one in reader.attachments()}
        problems = list(reader.problems)
    counts = {name: len(messages) for name, messages in raw.items()}
    if not counts:
        raise BagError(f"{path}: the bag holds no messages" + "".join(f"; {one}" for one in problems))
    loader = _Loader(*_without_namespace(path, infos, raw), problems)
    signals = loader.weld(Path(path))
    signals.attachments, signals.counts = attachments, counts
    if progress is not None:
        progress(1.0)
    return signals


def _without_namespace(
    path: Path | str, infos: Mapping[str, TopicInfo], raw: Mapping[str, list[tuple[int, bytes]]]
) -> tuple[dict[str, TopicInfo], dict[str, list[tuple[int, bytes]]]]:
    """The topics of the one weld in the bag, by the names that they have without namespace."""
    spaces = {match[1] for name in raw if (match := _OF_A_WELD.match(name))}
    if len(spaces) > 1 and "" not in spaces:
        raise BagError(f"{path}: holds several welds, in {', '.join(sorted(spaces))}: convert or record one of them")
    space = spaces.pop() if len(spaces) == 1 else ""
    return (
        {name.removeprefix(space): info for name, info in infos.items()},
        {name.removeprefix(space): messages for name, messages in raw.items()},
    )


class _Loader:
    """Builds `WeldSignals` from the raw messages."""

    def __init__(
        self, infos: Mapping[str, TopicInfo], raw: Mapping[str, list[tuple[int, bytes]]], problems: list[str]
    ) -> None:
        self._infos, self._raw, self._problems = infos, raw, problems

    def topic(self, name: str, wanted: Mapping[str, Kind]) -> _Topic | None:
        """Columns of a topic; None when the bag has none of its messages."""
        info, raw = self._infos.get(name), self._raw.get(name)
        if info is None or not raw:
            return None
        if info.encoding != "cdr" or not info.schema_text:
            self._problems.append(f"{name}: the bag holds no definition of {info.type_name or 'its type'}; left out")
            return None
        try:
            topic = _Topic(info, raw, wanted, self._problems)
        except BagError as error:
            self._problems.append(f"{name}: {error}")
            return None
        return topic if topic.log_ns.size else None

    def weld(self, path: Path) -> WeldSignals:
        """All signals."""
        sensors = {name: self.topic(topic, {name: "number"}) for name, (topic, _) in _SENSORS.items()}
        truth_wanted: dict[str, Kind] = {name: "number" for name, _ in _TRUTH.values()}
        truth = self.topic("/fsw/plant/truth", {**truth_wanted, "active_faults": "texts"})
        command = self.topic("/fsw/command", _COMMAND)
        sources = [one for one in sensors.values() if one is not None]
        sources = sources or [one for one in (truth, command) if one is not None]
        if not sources:
            found = ", ".join(sorted(self._raw)[:8])
            details = "".join(f"; {one}" for one in self._problems)
            raise BagError(
                f"{path}: not the bag of a weld: no readable message on {', '.join(t for t, _ in _SENSORS.values())}, "
                f"/fsw/plant/truth or /fsw/command; it has {found}{details}"
            )
        ticks = _Ticks(sources)
        nothing = np.full(ticks.stamp_ns.size, np.nan)
        empty: TextArray = np.full(ticks.stamp_ns.size, "", dtype=object)
        sensed: dict[str, FloatArray] = {}
        for name, (_, factor) in _SENSORS.items():
            one = sensors[name]
            values = nothing.copy() if one is None else ticks.number(one, one.numbers(name, factor), first_wins=True)
            sensed[name] = values
        signals = WeldSignals(
            path=path,
            stamp_ns=ticks.stamp_ns,
            time_s=ticks.time_s,
            depth_mm=sensed["depth"],
            torque_nm=sensed["torque"],
            temperature_c=sensed["temperature"],
            reference_depth_mm=nothing.copy(),
            reference_temperature_c=nothing.copy(),
            force_kn=nothing.copy(),
            speed_rpm=nothing.copy(),
            command_source=empty.copy(),
            command_reason=empty.copy(),
            command_latency_s=nothing.copy(),
            actual_controller=empty.copy(),
            actual_mode=empty.copy(),
            problems=self._problems,
        )
        events: list[WeldEvent] = []
        if command is not None:
            proposal = _proposal(ticks, command)
            signals.force_kn, signals.speed_rpm = proposal.force_kn, proposal.speed_rpm
            signals.command_reason, signals.command_latency_s = proposal.reason, proposal.latency_s
            signals.command_source = ticks.text(command, command.objects("source"))
        if truth is not None:
            signals.truth = _truth(ticks, truth)
            events += truth_events(ticks.time_s, signals.truth)
        self._references(ticks, signals, events)
        self._supervisor(ticks, signals, events)
        self._controllers(ticks, signals)
        self._other_events(ticks, events)
        signals.events = sorted(events, key=lambda event: event.time_s)
        return signals

    def _references(self, ticks: _Ticks, signals: WeldSignals, events: list[WeldEvent]) -> None:
        found = (self.topic(name, {"depth": "number", "temperature": "number"}) for name in REFERENCE_TOPICS)
        topic = next((one for one in found if one is not None), None)
        if topic is None:
            return
        held = ticks.held(topic)
        depth, temperature = topic.numbers("depth", 1e3), topic.numbers("temperature")
        signals.reference_depth_mm = np.where(held >= 0, depth[held], np.nan)
        signals.reference_temperature_c = np.where(held >= 0, temperature[held], np.nan)
        texts = [f"depth {d:.4g} mm, temperature {t:.5g} °C" for d, t in zip(depth, temperature, strict=True)]
        events += held_events("reference", ticks.times(topic), texts)

    def _supervisor(self, ticks: _Ticks, signals: WeldSignals, events: list[WeldEvent]) -> None:
        wanted: dict[str, Kind] = {"actual_controller": "text", "actual_mode": "text", "reason": "text"}
        topic = self.topic("/fsw/supervisor/state", wanted)
        if topic is None:
            return
        held, times = ticks.held(topic), ticks.times(topic)
        for name in ("actual_controller", "actual_mode"):
            values = topic.objects(name)
            setattr(signals, name, np.where(held >= 0, values[held], "").astype(object))
            reasons = topic.objects("reason")
            kind = name.removeprefix("actual_")
            events += held_events(kind, times, list(values), list(reasons))

    def _controllers(self, ticks: _Ticks, signals: WeldSignals) -> None:
        status_wanted: dict[str, Kind] = {name: "number" for name, _ in _STATUS_NUMBERS.values()}
        status_wanted |= {"solver_status": "text", "reason": "text", "active_limits": "texts"}
        status_wanted |= {"disturbance_names": "texts", "disturbances": "numbers"}
        for name in sorted(self._raw):
            if (match := _PROPOSAL.match(name)) and (topic := self.topic(name, _COMMAND)) is not None:
                signals.proposals[match[1]] = _proposal(ticks, topic)
            elif (match := _STATUS.match(name)) and (topic := self.topic(name, status_wanted)) is not None:
                signals.statuses[match[1]] = _status(ticks, topic)

    def _other_events(self, ticks: _Ticks, events: list[WeldEvent]) -> None:
        request = self.topic("/fsw/switch_request", {"data": "text"})
        if request is not None:
            events += text_events("switch_request", ticks.times(request), list(request.objects("data")))
        info = self._infos.get("/diagnostics")
        if info is not None and info.schema_text:
            events += diagnostic_events(info, self._raw.get("/diagnostics", []), int(ticks.stamp_ns[0]))


def _proposal(ticks: _Ticks, topic: _Topic) -> ProposalSignals:
    return ProposalSignals(
        force_kn=ticks.number(topic, topic.numbers("axial_force", 1e-3)),
        speed_rpm=ticks.number(topic, topic.numbers("spindle_speed", RPM_PER_RAD_S)),
        healthy=ticks.number(topic, topic.numbers("healthy")),
        reason=ticks.text(topic, topic.objects("reason")),
        latency_s=ticks.latency(topic),
    )


def _truth(ticks: _Ticks, topic: _Topic) -> TruthSignals:
    numbers: dict[str, Any] = {
        name: ticks.number(topic, topic.numbers(path, factor)) for name, (path, factor) in _TRUTH.items()
    }
    return TruthSignals(**numbers, active_faults=ticks.text(topic, topic.joined("active_faults")))


def _status(ticks: _Ticks, topic: _Topic) -> StatusSignals:
    numbers: dict[str, Any] = {
        name: ticks.number(topic, topic.numbers(path, factor)) for name, (path, factor) in _STATUS_NUMBERS.items()
    }
    status = StatusSignals(
        **numbers,
        solver_status=ticks.text(topic, topic.objects("solver_status")),
        reason=ticks.text(topic, topic.objects("reason")),
        active_limits=ticks.text(topic, topic.joined("active_limits")),
    )
    names, values = topic.objects("disturbance_names"), topic.objects("disturbances")
    columns: dict[str, FloatArray] = {}
    for row, (row_names, row_values) in enumerate(zip(names, values, strict=True)):
        for name, value in zip(row_names, row_values, strict=False):
            if name not in columns:
                columns[name] = np.full(names.size, np.nan)
            columns[name][row] = value
    status.disturbances = {name: ticks.number(topic, column) for name, column in columns.items()}
    return status
