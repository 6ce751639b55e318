"""Finds what happened during a weld: the events of its recorded messages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fsw_analysis.weld_signals import FloatArray, TruthSignals, WeldEvent
from fsw_recorder.definitions import Definitions
from fsw_recorder.errors import BagError
from fsw_recorder.topic import RecordedTopic

_LEVELS = {0: "ok", 1: "warning", 2: "error", 3: "stale"}
_WATCHDOG = {0: "ok", 1: "hold", 2: "safe state"}


def text_events(kind: str, times_s: FloatArray, texts: Sequence[str]) -> list[WeldEvent]:
    """One event per message."""
    return [WeldEvent(float(time_s), kind, text) for time_s, text in zip(times_s, texts, strict=True)]


def held_events(
    kind: str, times_s: FloatArray, values: Sequence[str], reasons: Sequence[str] | None = None
) -> list[WeldEvent]:
    """One event per change of a value that holds until the next message."""
    events: list[WeldEvent] = []
    last = None
    for index, value in enumerate(values):
        if value != last:
            reason = f" ({reasons[index]})" if reasons is not None and reasons[index] else ""
            events.append(WeldEvent(float(times_s[index]), kind, f"{value or 'none'}{reason}"))
            last = value
    return events


def truth_events(times_s: FloatArray, truth: TruthSignals) -> list[WeldEvent]:
    """Beginning and end of faults and disturbances, and the plant watchdog's actions."""
    events: list[WeldEvent] = []
    active: set[str] = set()
    for time_s, text in zip(times_s, truth.active_faults, strict=True):
        now = set(text.split(",")) - {""}
        events += [WeldEvent(float(time_s), "fault", f"{fault} begins") for fault in sorted(now - active)]
        events += [WeldEvent(float(time_s), "fault", f"{fault} ends") for fault in sorted(active - now)]
        active = now
    for name, values in (
        ("depth [mm]", truth.depth_disturbance_mm),
        ("temperature [°C]", truth.temperature_disturbance_c),
        ("axial force [kN]", truth.force_disturbance_kn),
        ("spindle speed [rpm]", truth.speed_disturbance_rpm),
    ):
        on = np.nan_to_num(values) != 0.0
        for row in np.flatnonzero(np.diff(on.astype(np.int8), prepend=0)):
            text = f"{name} begins with {values[row]:.4g}" if on[row] else f"{name} ends"
            events.append(WeldEvent(float(times_s[row]), "disturbance", text))
    watchdog = np.nan_to_num(truth.watchdog)
    for row in np.flatnonzero(np.diff(watchdog, prepend=0.0)):
        events.append(WeldEvent(float(times_s[row]), "watchdog", _WATCHDOG.get(int(watchdog[row]), "unknown")))
    return events


def diagnostic_events(topic: RecordedTopic, raw: Sequence[bytes], first_ns: int) -> list[WeldEvent]:
    """Changes of level of anything that reports on ``/diagnostics``; undecodable messages are passed over."""
    definitions = Definitions()
    levels: dict[str, int] = {}
    events: list[WeldEvent] = []
    for data in raw:
        try:
            message = definitions.decode(topic.type_name, topic.definition, data)
            stamp = message.header.stamp
            time_s = (stamp.sec * 1_000_000_000 + stamp.nanosec - first_ns) * 1e-9
            statuses = [(status.name, int(status.level), status.message) for status in message.status]
        except (BagError, AttributeError, TypeError, ValueError):
            continue  # damaged, also where the damage is in the schema and renames its fields
        for name, level, text in statuses:
            if levels.get(name, 0) != level:
                events.append(WeldEvent(time_s, "diagnostic", f"{name}: {_LEVELS.get(level, level)}: {text}"))
            levels[name] = level
    return events
