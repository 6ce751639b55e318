"""Deterministic replay: drives a controller from a bag and compares its proposals with the recorded ones, bit by bit.

Time comes from the bag alone. At every recorded proposal the controller gets what its node had then: the samples of
that stamp, judged by the same sensor validity, the reference in force and the command applied before. So the build
that was recorded reproduces its proposals exactly, and another build shows where it first differs and by how much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fsw_control.contract import SENSORS, Command, Controller, Reference
from fsw_control.host import answer
from fsw_control.parameters import ParameterError, load, validate
from fsw_control.references import ReferenceQueue
from fsw_control.units import kn_from_n, mm_from_m, n_from_kn, rad_s_from_rpm, rpm_from_rad_s
from fsw_control.validity import SensorGuard, SensorLimits
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.cdr_columns import CdrColumns, Column, Kind
from fsw_recorder.errors import BagError

#: from the controller's recorded parameters to the controller
Make = Callable[[dict[str, Any]], Controller]

_JUMP_NS = 1_000_000_000
_TOPICS = {
    "depth": ("/fsw/depth", "depth"),
    "torque": ("/fsw/spindle_torque", "torque"),
    "thermocouple": ("/fsw/thermocouple", "temperature"),
}
_WANTED: dict[str, Kind] = {"header.stamp.sec": "number", "header.stamp.nanosec": "number"}
_COMMAND: dict[str, Kind] = {"axial_force": "number", "spindle_speed": "number", "healthy": "number", "reason": "text"}


@dataclass(frozen=True, slots=True)
class Difference:
    """One tick at which the replayed proposal is not the recorded one.

    Attributes
    ----------
    tick : int
        Counted from 0 at the first recorded proposal.
    time_s : float
        Since the first recorded proposal.
    force_kn, speed_rpm : float
        Replayed minus recorded; NaN where one of both is not finite.
    text : str
        What else differs (health and its reason); empty when only the numbers do.
    """

    tick: int
    time_s: float
    force_kn: float
    speed_rpm: float
    text: str = ""


@dataclass(slots=True)
class Verification:
    """Result of a deterministic replay.

    Attributes
    ----------
    controller : str
        Its name in the bag.
    ticks : int
        Recorded proposals, all of them replayed.
    differences : list[Difference]
        In order of time; empty when all proposals are equal bit by bit.
    notes : list[str]
        What may keep a replay from being exact (no parameters in the bag, parameters changed on the way, …).
    """

    controller: str
    ticks: int
    differences: list[Difference] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def identical(self) -> bool:
        """Whether all proposals are equal bit by bit."""
        return not self.differences

    def lines(self) -> list[str]:
        """The result in words, without the notes."""
        if self.identical:
            return [f"{self.controller}: all {self.ticks} proposals reproduced bit by bit"]
        first = self.differences[0]
        what = f"{1e3 * first.force_kn:+.6g} N, {first.speed_rpm:+.6g} rpm" + (f", {first.text}" if first.text else "")
        force = max((abs(one.force_kn) for one in self.differences if not math.isnan(one.force_kn)), default=0.0)
        speed = max((abs(one.speed_rpm) for one in self.differences if not math.isnan(one.speed_rpm)), default=0.0)
        return [
            f"{self.controller}: {len(self.differences)} of {self.ticks} proposals differ",
            f"first at tick {first.tick}, {first.time_s:.1f} s: {what} (replayed minus recorded)",
            f"largest: {1e3 * force:.6g} N, {speed:.6g} rpm",
        ]


def recorded_controllers(path: Path | str) -> list[str]:
    """Names of the controllers whose proposals are in a bag.

    Raises
    ------
    BagError
        The bag cannot be read.
    """
    with BagReader(path) as reader:
        names = [name for name, topic in reader.topics().items() if topic.count]
    parts = [name.split("/") for name in names]
    return sorted(one[2] for one in parts if len(one) == 4 and one[1] == "fsw" and one[3] == "proposal")


def verify(path: Path | str, name: str, make: Make, parameters: tuple[str, str] | None = None) -> Verification:
    """Replay a controller on a bag and compare.

    Parameters
    ----------
    path : Path or str
        Bag with the sensor topics, commands, references and the controller's proposals.
    name : str
        The controller's name in the bag.
    make : callable
        Makes the controller from its parameters.
    parameters : (str, str), optional
        Package and file that describe its parameters; their values are taken from the bag where it has them.

    Raises
    ------
    BagError
        The bag cannot be read, lacks a topic, or the controller refuses its recorded parameters.
    """
    with BagReader(path) as reader:
        attachments = {one.name: one.data for one in reader.attachments()}
        tables = _Tables(reader, name)
    result = Verification(name, len(tables.proposals["stamp_ns"]))
    recorded = _recorded_parameters(attachments, name, result.notes)
    try:
        settings = validate(*_known(load("fsw_control", "controller.yaml"), recorded))
        own = validate(*_known(load(*parameters), recorded)) if parameters else {}
        controller = make(own)
    except (ParameterError, ValueError) as error:
        raise BagError(f"{path}: controller {name} refuses its recorded parameters: {error}") from None
    if tables.changed_parameters(name):
        result.notes.append(f"parameters of {name} were changed while it ran; the replay keeps the first ones")
    _replay(tables, controller, settings, result)
    return result


def _replay(tables: _Tables, controller: Controller, settings: dict[str, Any], result: Verification) -> None:
    guard = SensorGuard(_limits(settings))
    references = ReferenceQueue()
    applied = Command(settings["initial_force"], settings["initial_speed"])
    controller.reset(applied)
    commands, next_command = tables.commands, 0
    queue, next_reference = tables.references, 0
    last_ns: int | None = None
    stamps = tables.proposals["stamp_ns"]
    for tick, stamp_ns in enumerate(stamps.tolist()):
        while next_reference < len(queue) and queue[next_reference][0] <= tables.proposals["log_ns"][tick]:
            references.add(queue[next_reference][1], queue[next_reference][2])
            next_reference += 1
        while next_command < len(commands) and commands[next_command][0] < stamp_ns:
            applied = commands[next_command][1]
            next_command += 1
        if last_ns is not None and not 0 < stamp_ns - last_ns <= _JUMP_NS:
            guard.reset()
            controller.reset(applied)
            last_ns = None
        dt_s = settings["period"] if last_ns is None else (stamp_ns - last_ns) / 1e9
        last_ns = stamp_ns
        values = {sensor: tables.samples[sensor][stamp_ns] for sensor in SENSORS if stamp_ns in tables.samples[sensor]}
        measurement = guard.measure(stamp_ns * 1e-9, values)
        proposal = answer(controller, measurement, references.at(stamp_ns), applied, dt_s)
        difference = _compare(tables.proposals, tick, proposal.command, proposal.healthy, proposal.reason)
        if difference is not None:
            time_s = (stamp_ns - stamps[0]) * 1e-9
            result.differences.append(Difference(tick, float(time_s), *difference))


def _compare(
    recorded: Mapping[str, Column], tick: int, command: Command, healthy: bool, reason: str
) -> tuple[float, float, str] | None:
    force_n, speed_rad_s = float(recorded["axial_force"][tick]), float(recorded["spindle_speed"][tick])
    new_force_n, new_speed_rad_s = n_from_kn(command.force_kn), rad_s_from_rpm(command.speed_rpm)
    equal = _same(new_force_n, force_n) and _same(new_speed_rad_s, speed_rad_s)
    was_healthy, was_reason = bool(recorded["healthy"][tick]), str(recorded["reason"][tick])
    text = ""
    if (healthy, reason) != (was_healthy, was_reason):
        text = f"was {_health(was_healthy, was_reason)}, is {_health(healthy, reason)}"
    if equal and not text:
        return None
    return kn_from_n(new_force_n - force_n), rpm_from_rad_s(new_speed_rad_s - speed_rad_s), text


def _same(first: float, second: float) -> bool:
    return first == second or (math.isnan(first) and math.isnan(second))


def _health(healthy: bool, reason: str) -> str:
    return ("healthy" if healthy else "not healthy") + (f" ({reason})" if reason else "")


class _Tables:
    """What the bag holds for the replay of one controller."""

    def __init__(self, reader: BagReader, name: str) -> None:
        proposal = f"/fsw/{name}/proposal"
        names = [topic for topic, _ in _TOPICS.values()]
        self._raw: dict[str, list[tuple[int, bytes]]] = {}
        wanted = {*names, proposal, "/fsw/command", "/fsw/reference", "/parameter_events"}
        for record in reader.records(wanted):
            self._raw.setdefault(record.topic, []).append((record.log_time_ns, record.data))
        self._infos = {one.name: one for one in reader.known_topics()}
        missing = [topic for topic in (*names, proposal, "/fsw/reference") if topic not in self._raw]
        if missing:
            raise BagError(f"{reader.path}: cannot be replayed, it has no {', '.join(missing)}")
        self.proposals = self._table(proposal, _COMMAND)
        self.samples = {
            sensor: self._samples(topic, path, mm_from_m if sensor == "depth" else float)
            for sensor, (topic, path) in _TOPICS.items()
        }
        #: stamp and command, in order of receipt
        self.commands: list[tuple[int, Command]] = []
        if "/fsw/command" in self._raw:
            table = self._table("/fsw/command", _COMMAND)
            rows = zip(table["stamp_ns"].tolist(), table["axial_force"], table["spindle_speed"], strict=True)
            for stamp_ns, force, speed in rows:
                if math.isfinite(force) and math.isfinite(speed):
                    command = Command(kn_from_n(float(force)), rpm_from_rad_s(float(speed)))
                    self.commands.append((stamp_ns, command))
        table = self._table("/fsw/reference", {"depth": "number", "temperature": "number"})
        #: receive time, stamp and reference, in order of receipt
        self.references = [
            (log_ns, stamp_ns, Reference(mm_from_m(float(depth)), float(temperature)))
            for log_ns, stamp_ns, depth, temperature in zip(
                table["log_ns"].tolist(), table["stamp_ns"].tolist(), table["depth"], table["temperature"], strict=True
            )
            if 0.0 < depth < math.inf and 0.0 < temperature < math.inf
        ]

    def _table(self, topic: str, wanted: Mapping[str, Kind]) -> dict[str, Column]:
        info, raw = self._infos[topic], self._raw[topic]
        columns, good = CdrColumns(info.type_name, info.schema_text).extract(
            [data for _, data in raw], {**wanted, **_WANTED}
        )
        table = {path: column[good] for path, column in columns.items()}
        seconds, nanoseconds = table.pop("header.stamp.sec"), table.pop("header.stamp.nanosec")
        table["stamp_ns"] = seconds.astype(np.int64) * 1_000_000_000 + nanoseconds.astype(np.int64)
        table["log_ns"] = np.array([log_ns for log_ns, _ in raw], dtype=np.int64)[good]
        return table

    def _samples(self, topic: str, path: str, convert: Callable[[float], float]) -> dict[int, float]:
        table = self._table(topic, {path: "number"})
        samples: dict[int, float] = {}
        for stamp_ns, value in zip(table["stamp_ns"].tolist(), table[path].tolist(), strict=True):
            samples.setdefault(stamp_ns, convert(value))
        return samples

    def changed_parameters(self, name: str) -> bool:
        """Whether a parameter of the controller's node was changed after it had begun."""
        info, raw = self._infos.get("/parameter_events"), self._raw.get("/parameter_events", [])
        if info is None or not info.schema_text or not raw:
            return False
        columns, _ = CdrColumns(info.type_name, info.schema_text).extract([data for _, data in raw], {"node": "text"})
        begun = int(self.proposals["log_ns"][0])
        rows = zip(columns["node"], raw, strict=True)
        return any(node == f"/fsw_{name}" and log_ns > begun for node, (log_ns, _) in rows)


def _recorded_parameters(attachments: Mapping[str, bytes], name: str, notes: list[str]) -> dict[str, Any]:
    """Parameters of the controller's node, from the bag's attachments."""
    data = attachments.get(f"parameters/fsw_{name}.yaml")
    if data is None:
        notes.append(f"the bag has no parameters of {name}; its defaults are taken")
        return {}
    try:
        values = yaml.safe_load(data)[f"/fsw_{name}"]["ros__parameters"]
        return {str(key): value for key, value in values.items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, UnicodeDecodeError):
        notes.append(f"the parameters of {name} in the bag cannot be read; its defaults are taken")
        return {}


def _known(specs: Mapping[str, Any], recorded: Mapping[str, Any]) -> tuple[Mapping[str, Any], dict[str, Any]]:
    return specs, {key: value for key, value in recorded.items() if key in specs}


def _limits(settings: Mapping[str, Any]) -> dict[str, SensorLimits]:
    return {
        sensor: SensorLimits(
            minimum=settings[f"validity.{sensor}.minimum"],
            maximum=settings[f"validity.{sensor}.maximum"],
            max_rate=settings[f"validity.{sensor}.max_rate"],
            hold_s=settings["validity.hold"],
            frozen_samples=settings["validity.frozen_samples"],
            confirm_samples=settings["validity.confirm_samples"],
        )
        for sensor in SENSORS
    }
