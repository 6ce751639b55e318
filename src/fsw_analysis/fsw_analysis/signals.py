"""Turns the bag of a weld into aligned arrays in the paper's units."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from fsw_analysis import events
from fsw_analysis.messages import SENSOR_TOPICS, Column, Kind, Table, WeldMessages
from fsw_analysis.weld_signals import (
    MM,
    DriveSignals,
    FloatArray,
    FusedSignals,
    IntArray,
    ProposalSignals,
    StatusSignals,
    TruthSignals,
    WeldSignals,
    experiment_time_s,
)
from fsw_control.contract import Reference
from fsw_control.ranges import set_point_problem
from fsw_control.reason import Reason, ReasonCode
from fsw_control.references import OTHER_CLOCK_NS, OWN_CLOCK_NS, ReferenceQueue
from fsw_control.sensors import DEPTH_CHANNELS, REQUIRED, SENSORS
from fsw_control.units import NANOSECONDS, mm_from_m
from fsw_recorder.errors import BagError

Group = TypeVar("Group", ProposalSignals, StatusSignals, DriveSignals, TruthSignals)

#: fields of a message that has a reason; those of bags before it was an enum have ``reason``, in
#: words
FIELDS: dict[str, Kind] = {
    "why.code": "number",
    "why.sensors": "texts",
    "why.limit": "number",
    "why.detail": "text",
    "why.subject": "text",
    "why.interlocks": "texts",
    "reason": "text",
}


def reasons(table: Table) -> list[Reason]:
    """The reason of each message; of older bags its words, as those of a controller of its own."""
    columns = (table.column(path).tolist() for path in FIELDS)
    return [
        Reason.of(words)
        if code != code
        else Reason(
            ReasonCode(int(code)), tuple(sensors), limit_s, detail, subject, tuple(interlocks)
        )
        for code, sensors, limit_s, detail, subject, interlocks, words in zip(
            *columns, strict=True
        )
    ]


class _Ticks:
    """The plant's ticks, in order of their stamps: aligns everything else on them."""

    def __init__(self, sources: list[Table]) -> None:
        stamps = np.concatenate([source.stamp_ns for source in sources])
        self.stamp_ns: IntArray = np.unique(stamps)
        #: first receipt of a message of the tick
        self.log_ns: IntArray = np.full(self.stamp_ns.size, np.iinfo(np.int64).max)
        rows = np.searchsorted(self.stamp_ns, stamps)
        np.minimum.at(self.log_ns, rows, np.concatenate([source.log_ns for source in sources]))
        self.time_s = experiment_time_s(self.stamp_ns)

    def _rows(self, table: Table) -> IntArray:
        """The tick that each message answers, if it answers any."""
        return np.minimum(np.searchsorted(self.stamp_ns, table.stamp_ns), self.stamp_ns.size - 1)

    def align(self, table: Table, values: Column) -> Column:
        """Values at the ticks, the first per stamp (`JoinRules`); NaN or empty without any."""
        rows = self._rows(table)
        index = np.flatnonzero(self.stamp_ns[rows] == table.stamp_ns)[::-1]
        result = np.full(
            self.stamp_ns.size, "" if values.dtype == object else np.nan, dtype=values.dtype
        )
        result[rows[index]] = values[index]
        return result

    def signal(self, table: Table, path: str, factor: float, kind: str) -> Column:
        """A signal at the ticks; arguments as of `fsw_analysis.weld_signals.of`."""
        if kind == "number":
            return self.align(table, table.column(path) * factor)
        if kind == "latency":
            return self.align(table, (table.log_ns - self.log_ns[self._rows(table)]) * 1e-9)
        if kind == "reason":
            return self.align(table, np.array([reason.words for reason in reasons(table)], object))
        values = table.column(path)
        return self.align(
            table,
            values if kind == "text" else np.array([",".join(value) for value in values], object),
        )

    def group(self, kind: type[Group], table: Table, **more: Any) -> Group:
        """A group of signals from the fields of messages that its columns name."""
        values: dict[str, Any] = {
            item.name: self.signal(table, **item.metadata)
            for item in fields(kind)
            if item.metadata
        }
        return kind(**values, **more)

    def times_s(self, table: Table) -> FloatArray:
        """When messages hold: from their stamp, or receipt if it is 0 or of another clock."""
        by_stamp = self.time_s[0] + (table.stamp_ns - self.stamp_ns[0]) * 1e-9
        order = np.argsort(self.log_ns, kind="stable")
        tick = np.clip(
            np.searchsorted(self.log_ns[order], table.log_ns, side="right") - 1, 0, order.size - 1
        )
        by_receipt = self.time_s[order[tick]]
        foreign = (table.stamp_ns == 0) | (np.abs(by_stamp - by_receipt) > OTHER_CLOCK_NS * 1e-9)
        times: FloatArray = np.where(foreign, by_receipt, by_stamp)
        return times

    def held(self, table: Table, path: str, before: object = "") -> Column:
        """Values that persist from one message to the next, and the value before the first."""
        times = self.times_s(table)
        order = np.argsort(times, kind="stable")
        rows = np.searchsorted(times[order], self.time_s, side="right") - 1
        return np.append(table.column(path)[order], [before])[
            rows
        ]  # -1, before the first, is the last entry


def load_weld(path: Path | str, progress: Callable[[float], None] | None = None) -> WeldSignals:
    """Read the bag of a weld into aligned arrays.

    Parameters
    ----------
    path : Path or str
        Bag folder or file, of any storage; an unfinished or damaged one is read as far as
        possible. The weld may have run in a namespace.
    progress : callable, optional
        Called now and then with the fraction read, 0 to 1.

    Raises
    ------
    BagError
        There is no bag, it cannot be read, or it holds no weld, or several in namespaces.
    """
    messages = WeldMessages(path, progress)
    sensors = messages.sensors()
    truth = messages.table("/fsw/plant/truth", _wanted(TruthSignals))
    command = messages.table(
        "/fsw/command", {**_wanted(ProposalSignals), "source": "text"}, FIELDS
    )
    drives = messages.table("/fsw/drives", _wanted(DriveSignals))
    state = messages.table("/fsw/supervisor/state", events.STATE, events.STATE_ADDED)
    ticks = _Ticks(_sources(messages, [sensors[name][0] for name in REQUIRED], [truth, command]))
    known: dict[str, Any] = {
        name: ticks.align(*sensor)
        for name, sensor in sensors.items()
        if name in REQUIRED or sensor[0]
    }
    applied, depth = ticks.group(ProposalSignals, command), sensors["depth"][0]
    footprints = tuple(sorted(set(depth.column("footprint")) - {""}))
    taken_off_mm = np.nan_to_num(ticks.align(depth, depth.column("footprint_bias") * MM))
    depths_in_force, temperatures_in_force = _references(messages, ticks)
    signals = WeldSignals(
        path=messages.path,
        stamp_ns=ticks.stamp_ns,
        time_s=ticks.time_s,
        **{SENSORS[name].signal: known.pop(name) for name in REQUIRED},
        optional={SENSORS[name].signal: values for name, values in known.items()},
        reference_depth_mm=depths_in_force,
        reference_temperature_c=temperatures_in_force,
        force_kn=applied.force_kn,
        speed_rpm=applied.speed_rpm,
        command_source=ticks.align(command, command.column("source")),
        command_reason=applied.reason,
        command_latency_s=applied.latency_s,
        actual_controller=ticks.held(state, "actual_controller"),
        actual_mode=ticks.held(state, "actual_mode"),
        proposals={
            name: ticks.group(ProposalSignals, table)
            for name, table in _by_controller(messages, "proposal", _wanted(ProposalSignals))
        },
        statuses={
            name: ticks.group(StatusSignals, table, disturbances=_disturbances(ticks, table))
            for name, table in _by_controller(messages, "status", _STATUS)
        },
        fused=_fused(ticks, depth),
        footprint_bias_mm=taken_off_mm if footprints else 0.0,
        footprints_sha256=footprints,
        drives=ticks.group(DriveSignals, drives) if drives else None,
        truth=ticks.group(TruthSignals, truth) if truth else None,
        attachments=messages.attachments,
        custom=messages.custom,
        counts={name: len(raw) for name, raw in messages.raw.items()},
        namespace=messages.namespace,
        problems=messages.problems,
        events=list(events.of_states(events.states(ticks.times_s(state), state))),
    )
    _add_course(signals, messages, ticks)
    return signals


def _sources(messages: WeldMessages, sensors: list[Table], others: list[Table]) -> list[Table]:
    """Tables whose stamps are the ticks: the sensors', else others with one per tick."""
    sources = [sensor for sensor in sensors if sensor] or [other for other in others if other]
    if not sources:
        needed = [SENSOR_TOPICS[name] for name in REQUIRED]
        complaint = (
            f"{messages.path}: not the bag of a weld: no readable message on {', '.join(needed)}, "
            f"/fsw/plant/truth or /fsw/command; it has {', '.join(sorted(messages.raw)[:8])}"
        )
        raise BagError("; ".join([complaint, *messages.problems]))
    return sources


def _add_course(weld: WeldSignals, messages: WeldMessages, ticks: _Ticks) -> None:
    """Add the programme that was played, its phases, alarms, and operators' actions."""
    journal = messages.table("/fsw/alarms", events.ALARM, events.ALARM_CHANGE)
    weld.events += events.of_alarms(ticks.times_s(journal), journal)
    progress = messages.table("/fsw/weld_progress", events.PROGRESS)
    actions = messages.table("/fsw/operator_action", events.ACTION, events.ACTION_ADDED)
    health = messages.table("/fsw/monitor/health", {}, events.HEALTH)
    weld.events += events.of_health(ticks.times_s(health), health)
    times_s = ticks.times_s(progress)
    weld.phases = events.phases(times_s, progress)
    weld.events += [
        *events.of_progress(times_s, progress),
        *events.of_actions(ticks.times_s(actions), actions),
    ]
    weld.events.sort(key=lambda event: event.time_s)
    depth, temperature, angle = (
        ticks.held(progress, path, np.nan) for path in ("depth", "temperature", "angle")
    )
    weld.angle_deg = np.degrees(angle)
    weld.travel_mm = ticks.held(progress, "length", np.nan) * MM
    # where no programme is played, the set-points in force stand for its own
    weld.programme_depth_mm = np.where(depth > 0.0, depth * MM, weld.reference_depth_mm)
    weld.programme_temperature_c = np.where(depth > 0.0, temperature, weld.reference_temperature_c)


def _fused(ticks: _Ticks, depth: Table) -> FusedSignals | None:
    """Channels behind the depth; None for a single sensor and in bags of earlier versions."""
    names = list(DEPTH_CHANNELS)
    rows = depth.column("channel_health")
    known = np.array([len(row) == len(names) for row in rows], bool)
    if not known.any():
        return None
    health = np.full((len(depth), len(names)), np.nan)
    health[known] = np.stack(list(rows[known]))
    used = np.nan_to_num(depth.column("channels_used")).astype(np.int64)
    return FusedSignals(
        ticks.align(depth, depth.column("standard_deviation") * MM),
        {
            name: ticks.align(depth, (used >> k & 1).astype(np.float64))
            for k, name in enumerate(names)
        },
        {name: ticks.align(depth, health[:, k]) for k, name in enumerate(names)},
    )


def _wanted(kind: type[Any]) -> dict[str, Kind]:
    return {
        field.metadata["path"]: field.metadata["kind"]
        for field in fields(kind)
        if field.metadata.get("path")
    }


def _references(messages: WeldMessages, ticks: _Ticks) -> tuple[FloatArray, FloatArray]:
    """Depth [mm] and temperature [°C] in force at the ticks."""
    sent, held = (read_set_points(messages, topic) for topic in (SENT, HELD))
    points = timeline(sent, held, ticks.stamp_ns, ticks.log_ns, messages.problems)
    if not points and (SENT in messages.raw or HELD in messages.raw):
        messages.problems.append(f"{SENT}: no set-point could be read")
    rows = (
        np.searchsorted(
            np.array([begins for begins, _ in points], np.int64), ticks.stamp_ns, side="right"
        )
        - 1
    )
    depth_mm = np.array([*(point.depth_mm for _, point in points), np.nan])
    temperature_c = np.array([*(point.temperature_c for _, point in points), np.nan])
    return depth_mm[rows], temperature_c[rows]  # -1, before the first, is the last entry


def _by_controller(
    messages: WeldMessages, kind: str, columns: dict[str, Kind]
) -> Iterator[tuple[str, Table]]:
    """Controllers with their messages of one kind (``proposal`` or ``status``)."""
    for name, topic in messages.controllers(kind).items():
        if table := messages.table(topic, columns, FIELDS):
            yield name, table


def _disturbances(ticks: _Ticks, table: Table) -> dict[str, FloatArray]:
    columns: dict[str, FloatArray] = {}
    rows = zip(table.column("disturbance_names"), table.column("disturbances"), strict=True)
    for row, (names, values) in enumerate(rows):
        for name, value in zip(names, values, strict=False):
            if name not in columns:
                columns[name] = np.full(len(table), np.nan)
            columns[name][row] = value
    return {name: ticks.align(table, values) for name, values in columns.items()}


_STATUS: dict[str, Kind] = {
    **_wanted(StatusSignals),
    "disturbance_names": "texts",
    "disturbances": "numbers",
}
#: topics of set-points: as sent, as the supervisor reports them, and as announced
SENT, HELD, PLANNED = "/fsw/reference", "/fsw/supervisor/reference", "/fsw/reference_plan"
#: time after which a new recorder has received the latched messages
_JOINING_NS = 2 * NANOSECONDS
UNKNOWN_ORDER = (
    f"{SENT}: set-points were sent before the recording began, and this bag does not show in "
    "which order: errors and figures of merit may refer to the wrong ones"
)


class SetPoint(NamedTuple):
    """One message with set-points.

    Times in ns, ``issued_ns`` is its publication or its place in the order.
    """

    log_ns: int
    issued_ns: int
    stamp_ns: int
    depth_mm: float
    temperature_c: float

    @property
    def reference(self) -> Reference:
        """The set-points themselves."""
        return Reference(self.depth_mm, self.temperature_c)


def read_set_points(messages: WeldMessages, topic: str) -> list[SetPoint]:
    """Valid set-points that were sent (``SENT``) or reported, in order of receipt."""
    fields: dict[str, Kind] = {"depth": "number", "temperature": "number"}
    if topic != SENT:
        fields |= {"issued.sec": "number", "issued.nanosec": "number"}
    table = messages.table(topic, fields)
    issued = table.publish_ns.tolist()
    if topic != SENT:
        parts = zip(
            *(np.nan_to_num(table.column(f"issued.{part}")) for part in ("sec", "nanosec")),
            strict=True,
        )
        issued = [int(sec) * NANOSECONDS + int(nanosec) for sec, nanosec in parts]
    depths_mm = map(mm_from_m, table.column("depth").tolist())
    temperatures = table.column("temperature").tolist()
    rows = zip(
        table.log_ns.tolist(),
        issued,
        table.stamp_ns.tolist(),
        depths_mm,
        temperatures,
        strict=True,
    )
    return [
        point
        for point in map(SetPoint._make, rows)
        if not set_point_problem(point.depth_mm, point.temperature_c)
    ]


def timeline(
    sent: Sequence[SetPoint],
    held: Sequence[SetPoint],
    stamps: IntArray,
    logs: IntArray,
    problems: list[str],
) -> list[tuple[int, Reference]]:
    """Set-points with the stamp of the tick from which each holds, in order.

    The rule is that of the nodes, `fsw_control.references.ReferenceQueue`. What was published
    before the recording began counts from its first tick on.

    Parameters
    ----------
    sent, held : sequence of SetPoint
        Messages on the topics ``SENT`` and ``HELD``, in order of receipt.
    stamps, logs : int array, shape (n_ticks,)
        Stamp and receive time of every tick [ns], in order of stamps.
    problems : list of str
        Gets `UNKNOWN_ORDER` if the set-points in force at the start are ambiguous.
    """
    begin_ns = int(logs[0])
    if sent and all(point.issued_ns == point.log_ns for point in sent):
        # sqlite3 holds no publish times; what came together at first may then be older than the
        # recording
        until_ns = max(begin_ns, sent[0].log_ns + _JOINING_NS)
        early = [item for item in sent if item.log_ns < until_ns and item.stamp_ns <= stamps[0]]
        if len(early) > 1 and not held and not all(point.stamp_ns for point in early):
            problems.append(UNKNOWN_ORDER)
        sent = [p._replace(issued_ns=early.index(p)) if p in early else p for p in sent]
    queue = ReferenceQueue()
    queue.join(begin_ns - OWN_CLOCK_NS)  # from when on the order of receipt counts
    coming = deque(
        sorted(
            (begin_ns if point.issued_ns < begin_ns else point.log_ns, is_held, point)
            for is_held, points in ((False, sent), (True, held))
            for point in points
        )
    )
    begun: list[tuple[int, Reference]] = []
    for stamp_ns, log_ns in zip(stamps.tolist(), logs.tolist(), strict=True):
        while coming and coming[0][0] <= log_ns:
            _, is_held, added = coming.popleft()
            if is_held:
                queue.add(added.stamp_ns, added.reference, added.issued_ns)
            else:
                queue.receive(added.stamp_ns, added.reference, added.issued_ns, added.log_ns)
        present = queue.at(stamp_ns)
        if present is not None and (not begun or present != begun[-1][1]):
            begun.append((stamp_ns, present))
    return begun
