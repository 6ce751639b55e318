"""A weld of this process as a bag.

The topics that a recorder would have received, but none of the controllers' own.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cache
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from fsw_analysis.messages import SENSOR_TOPICS
from fsw_analysis.weld_signals import MM, TruthSignals, WeldSignals
from fsw_campaign.welds import progress
from fsw_control.cause import Cause
from fsw_control.reason import Reason
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_control.units import NANOSECONDS, RAD_PER_S_PER_RPM, m_from_mm, n_from_kn
from fsw_control.weld import TICK_NS
from fsw_recorder.bag_writer import BagWriter, RecordedTopic, WriterOptions
from fsw_recorder.definitions import Definitions, interface_definition, interface_hash
from fsw_recorder.recording import versions_text
from fsw_scenario.scenario import Scenario

TOPICS = {
    **{SENSOR_TOPICS[name]: SENSORS[name].message_type for name in REQUIRED},
    "/fsw/drives": "fsw_msgs/msg/DriveFeedback",
    "/fsw/plant/truth": "fsw_msgs/msg/PlantState",
    "/fsw/reference": "fsw_msgs/msg/WeldReference",
    "/fsw/command": "fsw_msgs/msg/WeldCommand",
    "/fsw/supervisor/state": "fsw_msgs/msg/SupervisorState",
    "/fsw/weld_progress": "fsw_msgs/msg/WeldProgress",
    "/fsw/operator_action": "fsw_msgs/msg/OperatorAction",
}
#: ticks between two reports of supervisor and programme
_REPORT = 10
#: messages after which the writer is waited for
_MANY = 20_000
#: what an operator did: tick, and the fields of the message
Actions = Mapping[int, Mapping[str, Any]]
#: fields of a topic's messages by tick
Rows = Sequence[Mapping[str, Any]]


@cache
def _versions() -> bytes:
    return versions_text()


def write(
    folder: Path,
    scenario: Scenario,
    signals: WeldSignals,
    custom: Mapping[str, str],
    parameters: Mapping[str, Mapping[str, Any]],
    actions: Actions,
) -> None:
    """Write the bag of a weld into a new folder; BagError if that exists or cannot be written.

    ``signals`` are of ``ClosedLoop``, with the programme's set-points as they are to be reported;
    ``custom`` has canister, lid, tool and machine, ``parameters`` those of each controller,
    ``actions`` what an operator did, by tick.
    """
    definitions, count = Definitions(), 0
    began_ns = time.time_ns() - signals.n_ticks * TICK_NS  # it is over when it is written
    texts = {kind: interface_definition(kind) for kind in TOPICS.values()}
    tables = list(_tables(scenario, signals))
    with BagWriter(
        folder, WriterOptions(compression="zstd", manifest=True), {**custom, "lost_messages": "0"}
    ) as writer:
        for name, kind in TOPICS.items():
            writer.add_topic(
                RecordedTopic(name, kind, interface_definition(kind), interface_hash(kind))
            )
        writer.attach("scenario.yaml", "application/yaml", scenario.text.encode())
        writer.attach("versions.json", "application/json", _versions())
        for name, values in parameters.items():
            text = yaml.safe_dump({f"/fsw_{name}": {"ros__parameters": dict(values)}})
            writer.attach(f"parameters/fsw_{name}.yaml", "application/yaml", text.encode())
        for tick, stamp_ns in enumerate(signals.stamp_ns.tolist()):
            sec, nanosec = divmod(stamp_ns, NANOSECONDS)
            header, log_ns = (
                {"stamp": {"sec": sec, "nanosec": nanosec}},
                began_ns + (tick + 1) * TICK_NS,
            )
            sent = [(topic, rows[tick]) for topic, rows, is_told in tables if is_told[tick]]
            sent += [("/fsw/operator_action", actions[tick])] if tick in actions else []
            for topic, values in sent:
                kind = TOPICS[topic]
                data = definitions.encode(kind, texts[kind], {**values, "header": header})
                writer.write(topic, data, log_ns, log_ns)
                count += 1
                if count % _MANY == 0:
                    writer.flush(60.0)
    if writer.error is not None:
        raise writer.error


def _tables(
    scenario: Scenario, signals: WeldSignals
) -> Iterator[tuple[str, Rows, Sequence[bool]]]:
    """Topics with the fields of their messages by tick, and the ticks that have a message."""
    points = _rows(
        depth=signals.reference_depth_mm / MM, temperature=signals.reference_temperature_c
    )
    yield "/fsw/reference", points, _changed(points, every=signals.n_ticks)
    for topic, rows in _sensors(signals).items():  # a sample that did not come is no message
        yield topic, rows, [all(value == value for value in row.values()) for row in rows]
    commands = _rows(
        axial_force=n_from_kn(1.0) * signals.force_kn,
        spindle_speed=RAD_PER_S_PER_RPM * signals.speed_rpm,
        source=signals.command_source,
        healthy=np.full(signals.n_ticks, True),
    )
    why = [Reason.of(words).fields for words in signals.command_reason]
    commands = [{**row, "why": reason} for row, reason in zip(commands, why, strict=True)]
    yield "/fsw/command", commands, [True] * signals.n_ticks
    states = _rows(
        actual_controller=signals.actual_controller,
        target_controller=signals.actual_controller,
        actual_mode=signals.actual_mode,
        target_mode=signals.actual_mode,
    )
    by = [{"cause": Cause.READY if row == states[0] else Cause.SWAP_REQUESTED} for row in states]
    yield (
        "/fsw/supervisor/state",
        [{**row, **who} for row, who in zip(states, by, strict=True)],
        _changed(states),
    )
    programme = _rows(
        depth=signals.programme_depth_mm / MM, temperature=signals.programme_temperature_c
    )
    phase_reports = progress(scenario, signals)
    reports = [
        {"state": str(now.state), "phase": now.phase, **point, "left": point != in_force}
        for now, point, in_force in zip(phase_reports, programme, points, strict=True)
    ]
    places = [
        {
            "angle": radians(now.angle_deg),
            "length": m_from_mm(now.length_mm),
            "time_left": now.time_left_s,
        }
        for now in phase_reports
    ]
    rows = [{**report, **place} for report, place in zip(reports, places, strict=True)]
    yield "/fsw/weld_progress", rows, _changed(reports)


def _rows(**columns: NDArray[Any]) -> Rows:
    values = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in values]


def _changed(rows: Rows, every: int = _REPORT) -> list[bool]:
    """Ticks at which a message changes or is repeated."""
    return [tick % every == 0 or row != rows[tick - 1] for tick, row in enumerate(rows)]


def _sensors(signals: WeldSignals) -> dict[str, Rows]:
    drives, truth = signals.drives, signals.truth
    assert drives is not None and truth is not None
    numbers = {
        field.metadata["path"]: getattr(truth, field.name) / field.metadata["factor"]
        for field in fields(TruthSignals)
        if field.metadata["kind"] == "number"
    }
    numbers |= {key: numbers[key].astype(np.int64) for key in ("watchdog", "refused_commands")}
    faults = ({"active_faults": text.split(",") if text else []} for text in truth.active_faults)
    return {
        **{
            SENSOR_TOPICS[name]: _rows(
                **{(row := SENSORS[name]).quantity.name: row.on_wire(getattr(signals, row.signal))}
            )
            for name in REQUIRED
        },
        "/fsw/drives": _rows(
            axial_force=n_from_kn(1.0) * drives.force_kn,
            spindle_speed=RAD_PER_S_PER_RPM * drives.speed_rpm,
        ),
        "/fsw/plant/truth": [
            {**row, **of} for row, of in zip(_rows(**numbers), faults, strict=True)
        ],
    }
