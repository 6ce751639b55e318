"""A weld of this process as a bag: the topics that a recorder would have received, but none of the controllers' own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from functools import cache
from math import nan, radians
from pathlib import Path
from typing import Any

import yaml

from fsw_analysis.weld_signals import MM, TruthSignals, WeldSignals
from fsw_control.units import NANOSECONDS, RAD_PER_S_PER_RPM, m_from_mm, n_from_kn
from fsw_control.weld import TICK_NS
from fsw_recorder.bag_writer import BagWriter, RecordedTopic, WriterOptions
from fsw_recorder.definitions import Definitions
from fsw_recorder.interface_text import interface_definition, interface_hash
from fsw_recorder.recording import versions_text
from fsw_scenario.scenario import Scenario
from fsw_scenario.weld_programme import READING_AGE_TICKS, PhaseMachine, Progress

TOPICS = {
    "/fsw/depth": "fsw_msgs/msg/ShoulderDepth",
    "/fsw/spindle_torque": "fsw_msgs/msg/SpindleTorque",
    "/fsw/thermocouple": "sensor_msgs/msg/Temperature",
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
Actions = Mapping[int, Mapping[str, str]]
#: topic and fields of a message
Told = tuple[str, dict[str, Any]]


class _Types:
    """Serializes messages; what is not given is zero or empty."""

    def __init__(self) -> None:
        definitions = Definitions()
        self._stores = {kind: definitions.typestore(kind, interface_definition(kind)) for kind in TOPICS.values()}
        self._empty = {kind: self._arguments(store, kind) for kind, store in self._stores.items()}

    def _arguments(self, store: Any, kind: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, (node, detail) in store.fielddefs[kind][1]:
            if node.name == "NAME":
                found[name] = store.types[detail](**self._arguments(store, detail))
            elif node.name == "BASE":
                found[name] = {"string": "", "bool": False}.get(detail[0], 0)
            else:
                found[name] = []
        return found

    def data(self, kind: str, stamp_ns: int, values: Mapping[str, Any]) -> bytes:
        """A message with the stamp of its tick."""
        store = self._stores[kind]
        stamp = store.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, NANOSECONDS))
        header = store.types["std_msgs/msg/Header"](stamp, "")
        return bytes(store.serialize_cdr(store.types[kind](**{**self._empty[kind], **values, "header": header}), kind))


@cache
def _versions() -> bytes:
    return versions_text()


def progress(scenario: Scenario, signals: WeldSignals) -> list[Progress]:
    """How far the programme had come at each tick, as its node would have told."""
    machine, shown, found = PhaseMachine(scenario.phases), [nan] * READING_AGE_TICKS, []
    readings = [*shown, *signals.temperature_c.tolist()]
    readings[: len(shown)] = [readings[len(shown)]] * len(shown)
    for tick in range(1, signals.n_ticks + 1):
        machine.follow(tick, readings[tick - 1])
        found.append(machine.progress())
    return found


def write(
    folder: Path,
    scenario: Scenario,
    signals: WeldSignals,
    custom: Mapping[str, str],
    parameters: Mapping[str, Mapping[str, Any]],
    actions: Actions,
) -> None:
    """Write the bag of a weld.

    Parameters
    ----------
    folder : Path
        The bag's, new.
    scenario : Scenario
        What was welded.
    signals : WeldSignals
        Of ``ClosedLoop``; its set-points of the programme are those that are told as the programme's.
    custom : mapping of str to str
        Canister, lid, tool and machine.
    parameters : mapping of str to mapping
        Of each controller, by its name.
    actions : mapping of int to mapping
        What an operator did, by tick.

    Raises
    ------
    fsw_recorder.errors.BagError
        The folder exists or cannot be written.
    """
    types, began_ns, count = _Types(), time.time_ns(), 0
    stamps = signals.stamp_ns.tolist()
    with BagWriter(
        folder, WriterOptions(compression="zstd", manifest=True), {**custom, "lost_messages": "0"}
    ) as writer:
        for name, kind in TOPICS.items():
            writer.add_topic(RecordedTopic(name, kind, interface_definition(kind), interface_hash(kind)))
        writer.attach("scenario.yaml", "application/yaml", scenario.text.encode())
        writer.attach("versions.json", "application/json", _versions())
        for name, values in parameters.items():
            text = yaml.safe_dump({f"/fsw_{name}": {"ros__parameters": dict(values)}})
            writer.attach(f"parameters/fsw_{name}.yaml", "application/yaml", text.encode())
        for tick, told in enumerate(_told(scenario, signals, actions)):
            log_ns = began_ns + (tick + 1) * TICK_NS
            for name, fields_of in told:
                writer.write(name, types.data(TOPICS[name], stamps[tick], fields_of), log_ns, log_ns)
                count += 1
                if count % _MANY == 0:
                    writer.flush(60.0)
    if writer.error is not None:
        raise writer.error


def _told(scenario: Scenario, signals: WeldSignals, actions: Actions) -> Iterator[list[Told]]:
    """The messages of each tick."""
    makers: tuple[Callable[[int], list[Told]], ...] = (
        _of_references(signals),
        _of_sensors(signals),
        _of_commands(signals),
        _of_states(signals),
        _of_programme(scenario, signals),
    )
    for tick in range(signals.n_ticks):
        told = [one for make in makers for one in make(tick)]
        if (action := actions.get(tick)) is not None:
            told.append(("/fsw/operator_action", dict(action)))
        yield told


def _of_references(signals: WeldSignals) -> Callable[[int], list[Told]]:
    rows = list(zip(signals.reference_depth_mm.tolist(), signals.reference_temperature_c.tolist(), strict=True))

    def make(tick: int) -> list[Told]:
        if tick and rows[tick] == rows[tick - 1]:
            return []
        return [("/fsw/reference", {"depth": m_from_mm(rows[tick][0]), "temperature": rows[tick][1]})]

    return make


def _of_sensors(signals: WeldSignals) -> Callable[[int], list[Told]]:
    drives, truth = signals.drives, signals.truth
    assert drives is not None and truth is not None
    columns = {
        "/fsw/depth": {"depth": signals.depth_mm / MM},
        "/fsw/spindle_torque": {"torque": signals.torque_nm},
        "/fsw/thermocouple": {"temperature": signals.temperature_c},
        "/fsw/drives": {
            "axial_force": n_from_kn(1.0) * drives.force_kn,
            "spindle_speed": RAD_PER_S_PER_RPM * drives.speed_rpm,
        },
        "/fsw/plant/truth": {
            one.metadata["path"]: getattr(truth, one.name) / one.metadata["factor"]
            for one in fields(TruthSignals)
            if one.metadata["kind"] == "number"
        },
    }
    rows = {topic: {key: one.tolist() for key, one in of.items()} for topic, of in columns.items()}
    for key in ("watchdog", "refused_commands"):
        rows["/fsw/plant/truth"][key] = [int(one) for one in rows["/fsw/plant/truth"][key]]
    rows["/fsw/plant/truth"]["active_faults"] = [one.split(",") if one else [] for one in truth.active_faults]
    known = {topic: signals_of for topic, signals_of in rows.items()}

    def make(tick: int) -> list[Told]:
        told = [(topic, {key: one[tick] for key, one in of.items()}) for topic, of in known.items()]
        # a sample that did not come is no message
        return [one for one in told if all(value == value for value in one[1].values())]

    return make


def _of_commands(signals: WeldSignals) -> Callable[[int], list[Told]]:
    columns = (
        (n_from_kn(1.0) * signals.force_kn).tolist(),
        (RAD_PER_S_PER_RPM * signals.speed_rpm).tolist(),
        signals.command_source.tolist(),
        signals.command_reason.tolist(),
    )

    def make(tick: int) -> list[Told]:
        force, speed, source, reason = (one[tick] for one in columns)
        values = {"axial_force": force, "spindle_speed": speed, "source": source, "healthy": True, "reason": reason}
        return [("/fsw/command", values)]

    return make


def _of_states(signals: WeldSignals) -> Callable[[int], list[Told]]:
    rows = list(zip(signals.actual_controller.tolist(), signals.actual_mode.tolist(), strict=True))

    def make(tick: int) -> list[Told]:
        changed = tick > 0 and rows[tick] != rows[tick - 1]
        if not changed and tick % _REPORT:
            return []
        controller, mode = rows[tick]
        return [
            (
                "/fsw/supervisor/state",
                {
                    "actual_controller": controller,
                    "target_controller": controller,
                    "actual_mode": mode,
                    "target_mode": mode,
                    "requested_by": "start" if rows[tick] == rows[0] else "operator (topic)",
                },
            )
        ]

    return make


def _of_programme(scenario: Scenario, signals: WeldSignals) -> Callable[[int], list[Told]]:
    rows = progress(scenario, signals)
    points = list(zip(signals.programme_depth_mm.tolist(), signals.programme_temperature_c.tolist(), strict=True))
    in_force = list(zip(signals.reference_depth_mm.tolist(), signals.reference_temperature_c.tolist(), strict=True))

    def make(tick: int) -> list[Told]:
        now = rows[tick]
        changed = not tick or (now.state, now.phase, points[tick]) != (
            rows[tick - 1].state,
            rows[tick - 1].phase,
            points[tick - 1],
        )
        if not changed and tick % _REPORT:
            return []
        return [
            (
                "/fsw/weld_progress",
                {
                    "state": str(now.state),
                    "phase": now.phase,
                    "angle": radians(now.angle_deg),
                    "length": m_from_mm(now.length_mm),
                    "time_left": now.time_left_s,
                    "depth": m_from_mm(points[tick][0]),
                    "temperature": points[tick][1],
                    "left": points[tick] != in_force[tick],
                },
            )
        ]

    return make
