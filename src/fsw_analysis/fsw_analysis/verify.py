"""Deterministic replay: drives a controller from a bag and compares its proposals with the recorded ones, bit by bit.

Time comes from the bag alone. At every recorded proposal the controller gets what its node had then: the samples of
that stamp, judged by the same sensor validity, the set-points in force and the command applied before. So the build
that was recorded reproduces its proposals exactly, and another build shows where it first differs and by how much.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fsw_analysis.columns import Column, Kind
from fsw_analysis.messages import Table, WeldMessages
from fsw_analysis.set_points import HELD, SENT, timeline
from fsw_control.contract import SENSORS, Command, Controller, Proposal, Reference
from fsw_control.host import answer
from fsw_control.parameters import ParameterError, load, validate
from fsw_control.units import kn_from_n, mm_from_m, n_from_kn, rad_s_from_rpm, rpm_from_rad_s
from fsw_control.validity import SensorGuard, sensor_limits
from fsw_recorder.errors import BagError

#: from the controller's recorded parameters to the controller
Make = Callable[[dict[str, Any]], Controller]

#: a longer pause of the measurements is a restart of time, as for the controller's node
_JUMP_NS = 1_000_000_000
_TOPICS = {
    "depth": ("/fsw/depth", "depth"),
    "torque": ("/fsw/spindle_torque", "torque"),
    "thermocouple": ("/fsw/thermocouple", "temperature"),
}
_DRIVES = "/fsw/drives"
_INPUTS: dict[str, Kind] = {"axial_force": "number", "spindle_speed": "number"}
_COMMAND: dict[str, Kind] = {**_INPUTS, "healthy": "number", "reason": "text"}
_PROPOSAL = re.compile(r"(?:/.*)?/fsw/([^/]+)/proposal")


@dataclass(frozen=True, slots=True)
class TickDifference:
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
    differences : list of TickDifference
        In order of time; empty when all proposals are equal bit by bit.
    notes : list of str
        What may keep a replay from being exact (no parameters in the bag, parameters changed on the way, …).
    """

    controller: str
    ticks: int
    differences: list[TickDifference] = field(default_factory=list)
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
    """Names of the controllers whose proposals are in a bag, in whatever namespace.

    Raises
    ------
    BagError
        The bag cannot be read, or holds several welds.
    """
    messages = WeldMessages(path)
    return sorted(match[1] for name in messages.raw if (match := _PROPOSAL.fullmatch(name)))


def verify(path: Path | str, name: str, make: Make, parameters: tuple[str, str] | None = None) -> Verification:
    """Replay a controller on a bag and compare.

    Parameters
    ----------
    path : Path or str
        Bag with the sensor topics, commands, set-points and the controller's proposals.
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
    recorded = _Recorded(path, name)
    result = Verification(name, recorded.proposals.log_ns.size)
    values = _recorded_parameters(recorded.messages, name, result.notes)
    try:
        settings = validate(*_known(load("fsw_control", "controller.yaml"), values))
        own = validate(*_known(load(*parameters), values)) if parameters else {}
        controller = make(own)
    except (ParameterError, ValueError) as error:
        raise BagError(f"{path}: controller {name} refuses its recorded parameters: {error}") from None
    if recorded.parameters_changed(name):
        result.notes.append(f"parameters of {name} were changed while it ran; the replay keeps the first ones")
    _replay(recorded, controller, settings, result)
    return result


def _replay(recorded: _Recorded, controller: Controller, settings: dict[str, Any], result: Verification) -> None:
    guard = SensorGuard(sensor_limits(settings))
    applied = Command(settings["initial_force"], settings["initial_speed"])
    controller.reset(applied)
    stamps: list[int] = recorded.proposals.stamp_ns.tolist()
    points = timeline(*recorded.set_points, recorded.proposals.stamp_ns, recorded.proposals.log_ns, result.notes)
    commands, next_command, next_point = recorded.commands, 0, 0
    reference: Reference | None = None
    last_ns: int | None = None
    for tick, stamp_ns in enumerate(stamps):
        while next_point < len(points) and points[next_point][0] <= stamp_ns:
            reference = Reference(points[next_point][1].depth_mm, points[next_point][1].temperature_c)
            next_point += 1
        while next_command < len(commands) and commands[next_command][0] < stamp_ns:
            applied = commands[next_command][1]
            next_command += 1
        if last_ns is not None and not 0 < stamp_ns - last_ns <= _JUMP_NS:
            guard.reset()
            controller.reset(applied)
            last_ns = None
        dt_s = settings["period"] if last_ns is None else (stamp_ns - last_ns) / 1e9
        last_ns = stamp_ns
        samples = recorded.samples
        values = {sensor: samples[sensor][stamp_ns] for sensor in SENSORS if stamp_ns in samples[sensor]}
        measurement = guard.measure(stamp_ns * 1e-9, values, recorded.drives.get(stamp_ns))
        proposal = answer(controller, measurement, reference, applied, dt_s)
        difference = _compare(recorded.columns, tick, proposal)
        if difference is not None:
            result.differences.append(TickDifference(tick, (stamp_ns - stamps[0]) * 1e-9, *difference))


def _compare(recorded: Mapping[str, Column], tick: int, proposal: Proposal) -> tuple[float, float, str] | None:
    force_n, speed_rad_s = float(recorded["axial_force"][tick]), float(recorded["spindle_speed"][tick])
    new_force_n, new_speed_rad_s = n_from_kn(proposal.command.force_kn), rad_s_from_rpm(proposal.command.speed_rpm)
    was = bool(recorded["healthy"][tick]), str(recorded["reason"][tick])
    now = proposal.healthy, proposal.reason
    text = "" if was == now else f"was {_health(*was)}, is {_health(*now)}"
    if _same(new_force_n, force_n) and _same(new_speed_rad_s, speed_rad_s) and not text:
        return None
    return kn_from_n(new_force_n - force_n), rpm_from_rad_s(new_speed_rad_s - speed_rad_s), text


def _same(first: float, second: float) -> bool:
    return first == second or (math.isnan(first) and math.isnan(second))


def _health(healthy: bool, reason: str) -> str:
    return ("healthy" if healthy else "not healthy") + (f" ({reason})" if reason else "")


class _Recorded:
    """What the bag holds for the replay of one controller."""

    def __init__(self, path: Path | str, name: str) -> None:
        proposal = f"/fsw/{name}/proposal"
        sensors = [topic for topic, _ in _TOPICS.values()]
        self.messages = WeldMessages(
            path, {*sensors, _DRIVES, proposal, "/fsw/command", SENT, HELD, "/parameter_events"}
        )
        tables = {topic: self.messages.table(topic, {field: "number"}) for topic, field in _TOPICS.values()}
        proposals = self.messages.table(proposal, _COMMAND)
        self.set_points = self.messages.set_points()
        missing = [topic for topic, table in {**tables, proposal: proposals}.items() if table is None]
        missing += [] if any(self.set_points) else [SENT]
        if missing or proposals is None:
            raise BagError(f"{path}: cannot be replayed, it has no {', '.join(missing)}")
        self.proposals = proposals
        self.columns = {path: proposals.objects(path) for path in _COMMAND}
        #: value by stamp, by sensor; of several with one stamp the first
        self.samples = {sensor: _samples(tables[topic], field) for sensor, (topic, field) in _TOPICS.items()}
        #: stamp and command, in order of receipt
        self.commands = _commands(self.messages.table("/fsw/command", _COMMAND))
        #: what the drives reported, by stamp
        self.drives = dict(_commands(self.messages.table(_DRIVES, _INPUTS)))

    def parameters_changed(self, name: str) -> bool:
        """Whether a parameter of the controller's node was changed after its start."""
        table = self.messages.table("/parameter_events", {"node": "text"})
        if table is None:
            return False
        own = table.objects("node") == f"{self.messages.namespace}/fsw_{name}"
        return bool((own & (table.log_ns > self.proposals.log_ns[0])).any())


def _commands(table: Table | None) -> list[tuple[int, Command]]:
    if table is None:
        return []
    columns = (table.stamp_ns, table.numbers("axial_force"), table.numbers("spindle_speed"))
    rows = zip(*(values.tolist() for values in columns), strict=True)
    return [
        (stamp_ns, Command(kn_from_n(force), rpm_from_rad_s(speed)))
        for stamp_ns, force, speed in rows
        if math.isfinite(force) and math.isfinite(speed)
    ]


def _samples(table: Table | None, field: str) -> dict[int, float]:
    samples: dict[int, float] = {}
    if table is not None:
        for stamp_ns, value in zip(table.stamp_ns.tolist(), table.numbers(field).tolist(), strict=True):
            samples.setdefault(stamp_ns, mm_from_m(value) if field == "depth" else value)
    return samples


def _recorded_parameters(messages: WeldMessages, name: str, notes: list[str]) -> dict[str, Any]:
    """Parameters of the controller's node, from the bag's attachments."""
    try:
        return messages.parameters(name)
    except BagError as error:
        notes.append(f"{error}; its defaults are used")
        return {}


def _known(specs: Mapping[str, Any], recorded: Mapping[str, Any]) -> tuple[Mapping[str, Any], dict[str, Any]]:
    return specs, {key: value for key, value in recorded.items() if key in specs}
