"""Turns the bag of a weld into aligned arrays in the paper's units."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from fsw_analysis.columns import Kind
from fsw_analysis.messages import Table, WeldMessages
from fsw_analysis.set_points import HELD, SENT, timeline
from fsw_analysis.weld_events import diagnostic_events, held_events, text_events, truth_events
from fsw_analysis.weld_signals import (
    MM,
    DriveSignals,
    FloatArray,
    IntArray,
    ProposalSignals,
    StatusSignals,
    TextArray,
    TruthSignals,
    WeldEvent,
    WeldSignals,
)
from fsw_recorder.errors import BagError

Group = TypeVar("Group", ProposalSignals, StatusSignals, DriveSignals, TruthSignals)

#: a stamp further than this from the ticks around it comes from another clock, as `ReferenceQueue` sees it
_OTHER_CLOCK_S = 36_000.0
#: field of a sensor's message: topic, factor to the paper's unit
_SENSORS = {
    "depth": ("/fsw/depth", MM),
    "torque": ("/fsw/spindle_torque", 1.0),
    "temperature": ("/fsw/thermocouple", 1.0),
}
_PROPOSAL = re.compile(r"^/fsw/([^/]+)/proposal$")
_STATUS = re.compile(r"^/fsw/([^/]+)/status$")
#: share of the time that reading the file takes
_READING = 0.8


class _Ticks:
    """The plant's ticks: aligns everything else on them."""

    def __init__(self, sources: list[Table]) -> None:
        stamps = np.concatenate([one.stamp_ns for one in sources])
        logs = np.concatenate([one.log_ns for one in sources])
        self.stamp_ns: IntArray = np.unique(stamps)
        rows = np.searchsorted(self.stamp_ns, stamps)
        self.log_ns: IntArray = np.full(self.stamp_ns.size, np.iinfo(np.int64).max, dtype=np.int64)
        np.minimum.at(self.log_ns, rows, logs)
        self.time_s: FloatArray = (self.stamp_ns - self.stamp_ns[0]) * 1e-9

    def rows(self, table: Table, first_wins: bool = False) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Row of the tick, and index of the message, for messages whose stamp is a tick's; one message per tick."""
        at = np.minimum(np.searchsorted(self.stamp_ns, table.stamp_ns), self.stamp_ns.size - 1)
        index = np.flatnonzero(self.stamp_ns[at] == table.stamp_ns)
        if first_wins:
            index = index[::-1]
        last = np.full(self.stamp_ns.size, -1, dtype=np.int64)
        last[at[index]] = index
        rows = np.flatnonzero(last >= 0)
        return rows, last[rows]

    def number(self, table: Table, values: FloatArray, first_wins: bool = False) -> FloatArray:
        """Values at the ticks, NaN where there is none."""
        rows, index = self.rows(table, first_wins)
        result = np.full(self.stamp_ns.size, np.nan)
        result[rows] = values[index]
        return result

    def text(self, table: Table, values: TextArray) -> TextArray:
        """Texts at the ticks, empty where there is none."""
        rows, index = self.rows(table)
        result = np.full(self.stamp_ns.size, "", dtype=object)
        result[rows] = values[index]
        return result

    def latency(self, table: Table) -> FloatArray:
        """From the first recorded measurement of the tick to the recorded message [s]."""
        rows, index = self.rows(table)
        result = np.full(self.stamp_ns.size, np.nan)
        result[rows] = (table.log_ns[index] - self.log_ns[rows]) * 1e-9
        return result

    def group(self, kind: type[Group], table: Table) -> Group:
        """A group of signals from the fields of messages that its columns name."""
        values: dict[str, Any] = {}
        for one in fields(kind):
            path = one.metadata.get("path")
            if path is None:
                continue
            if one.metadata["kind"] == "number":
                values[one.name] = self.number(table, table.numbers(path, one.metadata["factor"]))
            elif one.metadata["kind"] == "latency":
                values[one.name] = self.latency(table)
            else:
                texts = table.joined(path) if one.metadata["kind"] == "texts" else table.objects(path)
                values[one.name] = self.text(table, texts)
        return kind(**values)

    def times(self, table: Table) -> FloatArray:
        """Seconds since the first tick: by stamp, and by receipt where the stamp is zero or of another clock."""
        by_stamp = (table.stamp_ns - self.stamp_ns[0]) * 1e-9
        order = np.argsort(self.log_ns, kind="stable")
        at = np.clip(np.searchsorted(self.log_ns[order], table.log_ns, side="right") - 1, 0, order.size - 1)
        by_receipt = self.time_s[order[at]]
        return np.where((table.stamp_ns == 0) | (np.abs(by_stamp - by_receipt) > _OTHER_CLOCK_S), by_receipt, by_stamp)


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
    report = (lambda done: progress(_READING * done)) if progress is not None else None
    messages = WeldMessages(path, progress=report)
    signals = _signals(messages, Path(path))
    if progress is not None:
        progress(1.0)
    return signals


def _signals(messages: WeldMessages, path: Path) -> WeldSignals:
    sensors = {name: messages.table(topic, {name: "number"}) for name, (topic, _) in _SENSORS.items()}
    truth = messages.table("/fsw/plant/truth", _wanted(TruthSignals))
    command = messages.table("/fsw/command", {**_wanted(ProposalSignals), "source": "text"})
    sources = [one for one in sensors.values() if one is not None]
    sources = sources or [one for one in (truth, command) if one is not None]
    if not sources:
        details = "".join(f"; {one}" for one in messages.problems)
        raise BagError(
            f"{path}: not the bag of a weld: no readable message on {', '.join(t for t, _ in _SENSORS.values())}, "
            f"/fsw/plant/truth or /fsw/command; it has {', '.join(sorted(messages.raw)[:8])}{details}"
        )
    ticks = _Ticks(sources)

    def sensed(name: str) -> FloatArray:
        table = sensors[name]
        if table is None:
            return np.full(ticks.stamp_ns.size, np.nan)
        return ticks.number(table, table.numbers(name, _SENSORS[name][1]), first_wins=True)

    def nothing() -> FloatArray:
        return np.full(ticks.stamp_ns.size, np.nan)

    def empty() -> TextArray:
        return np.full(ticks.stamp_ns.size, "", dtype=object)

    signals = WeldSignals(
        path=path,
        stamp_ns=ticks.stamp_ns,
        time_s=ticks.time_s,
        depth_mm=sensed("depth"),
        torque_nm=sensed("torque"),
        temperature_c=sensed("temperature"),
        reference_depth_mm=nothing(),
        reference_temperature_c=nothing(),
        force_kn=nothing(),
        speed_rpm=nothing(),
        command_source=empty(),
        command_reason=empty(),
        command_latency_s=nothing(),
        actual_controller=empty(),
        actual_mode=empty(),
        attachments=messages.attachments,
        counts={name: len(raw) for name, raw in messages.raw.items()},
        namespace=messages.namespace,
        problems=messages.problems,
    )
    events: list[WeldEvent] = []
    if command is not None:
        applied = ticks.group(ProposalSignals, command)
        signals.force_kn, signals.speed_rpm = applied.force_kn, applied.speed_rpm
        signals.command_reason, signals.command_latency_s = applied.reason, applied.latency_s
        signals.command_source = ticks.text(command, command.objects("source"))
    if truth is not None:
        signals.truth = ticks.group(TruthSignals, truth)
        events += truth_events(ticks.time_s, signals.truth)
    drives = messages.table("/fsw/drives", _wanted(DriveSignals))
    if drives is not None:
        signals.drives = ticks.group(DriveSignals, drives)
    _add_set_points(messages, ticks, signals, events)
    _add_supervisor(messages, ticks, signals, events)
    _add_controllers(messages, ticks, signals)
    request = messages.table("/fsw/switch_request", {"data": "text"})
    if request is not None:
        events += text_events("switch_request", ticks.times(request), list(request.objects("data")))
    diagnostics = messages.topics.get("/diagnostics")
    if diagnostics is not None and diagnostics.definition:
        raw = [data for _, _, data in messages.raw.get("/diagnostics", [])]
        events += diagnostic_events(diagnostics, raw, int(ticks.stamp_ns[0]))
    signals.events = sorted(events, key=lambda event: event.time_s)
    return signals


def _wanted(kind: type[Any]) -> dict[str, Kind]:
    kinds = {one.metadata["path"]: one.metadata["kind"] for one in fields(kind) if one.metadata.get("path")}
    return kinds


def _add_set_points(messages: WeldMessages, ticks: _Ticks, signals: WeldSignals, events: list[WeldEvent]) -> None:
    sent, held = messages.set_points()
    points = timeline(sent, held, ticks.stamp_ns, ticks.log_ns, messages.problems)
    if not points:
        if SENT in messages.raw or HELD in messages.raw:
            messages.problems.append(f"{SENT}: no set-point could be read")
        return
    at = np.searchsorted([begins for begins, _ in points], ticks.stamp_ns, side="right") - 1
    for name in ("depth_mm", "temperature_c"):
        values = np.array([getattr(point, name) for _, point in points])
        setattr(signals, f"reference_{name}", np.where(at >= 0, values[at], np.nan))
    times = np.array([(max(begins, int(ticks.stamp_ns[0])) - int(ticks.stamp_ns[0])) * 1e-9 for begins, _ in points])
    texts = [f"depth {point.depth_mm:.4g} mm, temperature {point.temperature_c:.5g} °C" for _, point in points]
    first = max(int(at[0]), 0)  # those before held only before the recording
    events += held_events("reference", times[first:], texts[first:])


def _add_supervisor(messages: WeldMessages, ticks: _Ticks, signals: WeldSignals, events: list[WeldEvent]) -> None:
    names = ("actual_controller", "actual_mode")
    wanted: dict[str, Kind] = {**dict.fromkeys(names, "text"), "reason": "text"}  # type: ignore[dict-item]
    table = messages.table("/fsw/supervisor/state", wanted)
    if table is None:
        return
    times = ticks.times(table)
    order = np.argsort(times, kind="stable")
    at = np.searchsorted(times[order], ticks.time_s, side="right") - 1
    for name in names:
        values = table.objects(name)
        setattr(signals, name, np.where(at >= 0, values[order[np.maximum(at, 0)]], "").astype(object))
        events += held_events(name.removeprefix("actual_"), times, list(values), list(table.objects("reason")))


def _add_controllers(messages: WeldMessages, ticks: _Ticks, signals: WeldSignals) -> None:
    named: dict[str, Kind] = {"disturbance_names": "texts", "disturbances": "numbers"}
    for name in sorted(messages.raw):
        if match := _PROPOSAL.match(name):
            table = messages.table(name, _wanted(ProposalSignals))
            if table is not None:
                signals.proposals[match[1]] = ticks.group(ProposalSignals, table)
        elif match := _STATUS.match(name):
            table = messages.table(name, {**_wanted(StatusSignals), **named})
            if table is not None:
                status = signals.statuses[match[1]] = ticks.group(StatusSignals, table)
                status.disturbances = _disturbances(ticks, table)


def _disturbances(ticks: _Ticks, table: Table) -> dict[str, FloatArray]:
    columns: dict[str, FloatArray] = {}
    rows = zip(table.objects("disturbance_names"), table.objects("disturbances"), strict=True)
    for row, (names, values) in enumerate(rows):
        for name, value in zip(names, values, strict=False):
            if name not in columns:
                columns[name] = np.full(table.log_ns.size, np.nan)
            columns[name][row] = value
    return {name: ticks.number(table, values) for name, values in columns.items()}
