"""Deterministic replay: drives a controller from a bag and compares its proposals with the recorded ones, bit by bit.

Time comes from the bag alone. At every recorded proposal the controller gets what its node had then: the samples of
that stamp, judged by the same sensor validity, the set-points in force and the command applied before. So the build
that was recorded reproduces its proposals exactly, and another build shows where it first differs and by how much.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from fsw_analysis.columns import Kind
from fsw_analysis.messages import SENSOR_FIELDS, Table, WeldMessages, recorded_parameters
from fsw_analysis.set_points import HELD, SENT, read_set_points, timeline
from fsw_control.contract import Command, Controller, Proposal, Reference
from fsw_control.host import answer
from fsw_control.parameters import ParameterError, load, validate
from fsw_control.units import NANOSECONDS, kn_from_n, mm_from_m, n_from_kn, rad_s_from_rpm, rpm_from_rad_s
from fsw_control.validity import SensorGuard, sensor_limits
from fsw_recorder.errors import BagError

#: from the controller's recorded parameters to the controller
Make = Callable[[dict[str, Any]], Controller]
Entry = TypeVar("Entry")

#: a longer pause of the measurements is a restart of time, as for the controller's node
_JUMP_NS = NANOSECONDS
_INPUTS: dict[str, Kind] = {"axial_force": "number", "spindle_speed": "number"}
_PROPOSAL: dict[str, Kind] = {**_INPUTS, "healthy": "number", "reason": "text"}


@dataclass(frozen=True, slots=True)
class TickDifference:
    """One tick at which the replayed proposal is not the recorded one.

    Attributes
    ----------
    tick, time_s : int, float
        From the first recorded proposal on.
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
    return list(WeldMessages(path).controllers("proposal"))


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
    messages, notes = recorded.messages, []
    values: dict[str, Any] = {}
    try:
        values = recorded_parameters(messages.attachments, messages.namespace, name)
    except BagError as error:
        notes.append(f"{error}; its defaults are used")
    try:
        settings = _validated(("fsw_control", "controller.yaml"), values)
        controller = make(_validated(parameters, values) if parameters else {})
    except (ParameterError, ValueError) as error:
        raise BagError(f"{path}: controller {name} refuses its recorded parameters: {error}") from None
    if recorded.parameters_changed(name):
        notes.append(f"parameters of {name} were changed while it ran; the replay keeps the first ones")
    proposals = recorded.proposals
    points = timeline(recorded.sent, recorded.held, proposals.stamp_ns, proposals.log_ns, notes)
    references = [(begin_ns, Reference(one.depth_mm, one.temperature_c)) for begin_ns, one in points]
    return Verification(name, len(proposals), _replay(recorded, references, controller, settings), notes)


def _validated(described: tuple[str, str], recorded: Mapping[str, Any]) -> dict[str, Any]:
    specs = load(*described)
    return validate(specs, {key: value for key, value in recorded.items() if key in specs})


def _replay(
    recorded: _Recorded, references: list[tuple[int, Reference]], controller: Controller, settings: dict[str, Any]
) -> list[TickDifference]:
    """Differences of the controller's new answers to the recorded measurements."""
    guard = SensorGuard(sensor_limits(settings))
    applied = Command(settings["initial_force"], settings["initial_speed"])
    controller.reset(applied)
    stamps: list[int] = recorded.proposals.stamp_ns.tolist()
    columns = [recorded.proposals.column(path).tolist() for path in _PROPOSAL]
    coming: deque[tuple[int, Reference | None]] = deque(references)
    commands = deque(recorded.commands)
    reference: Reference | None = None
    last_ns: int | None = None
    differences: list[TickDifference] = []
    for tick, (stamp_ns, *was) in enumerate(zip(stamps, *columns, strict=True)):
        reference = _latest(coming, stamp_ns, reference)
        applied = _latest(commands, stamp_ns - 1, applied)
        if last_ns is not None and not 0 < stamp_ns - last_ns <= _JUMP_NS:
            guard.reset()
            controller.reset(applied)
            last_ns = None
        dt_s = settings["period"] if last_ns is None else (stamp_ns - last_ns) / NANOSECONDS
        last_ns = stamp_ns
        values = {sensor: samples[stamp_ns] for sensor, samples in recorded.samples.items() if stamp_ns in samples}
        measurement = guard.measure(stamp_ns * 1e-9, values, recorded.drives.get(stamp_ns))
        difference = _compare(answer(controller, measurement, reference, applied, dt_s), *was)
        if difference is not None:
            differences.append(TickDifference(tick, (stamp_ns - stamps[0]) * 1e-9, *difference))
    return differences


def _latest(waiting: deque[tuple[int, Entry]], until_ns: int, present: Entry) -> Entry:
    """Take the entries up to a time out of the queue; the last of them, or else the present one."""
    while waiting and waiting[0][0] <= until_ns:
        _, present = waiting.popleft()
    return present


def _compare(
    proposal: Proposal, force_n: float, speed_rad_s: float, healthy: float, reason: str
) -> tuple[float, float, str] | None:
    """Force [kN], speed [rpm] and words by which a proposal differs from the recorded values; None if in nothing."""
    new_force_n, new_speed_rad_s = n_from_kn(proposal.command.force_kn), rad_s_from_rpm(proposal.command.speed_rpm)
    was, now = (bool(healthy), reason), (proposal.healthy, proposal.reason)
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
        own = f"/fsw/{name}/proposal"
        topics = [topic for topic, _ in SENSOR_FIELDS.values()]
        self.messages = WeldMessages(path)
        sensors = [self.messages.table(topic, {field: "number"}) for topic, field in SENSOR_FIELDS.values()]
        self.proposals = self.messages.table(own, _PROPOSAL)
        self.sent, self.held = (read_set_points(self.messages, topic) for topic in (SENT, HELD))
        missing = [topic for topic, table in zip([*topics, own], [*sensors, self.proposals], strict=True) if not table]
        missing += [] if self.sent or self.held else [SENT]
        if missing:
            raise BagError(f"{path}: cannot be replayed, it has no {', '.join(missing)}")
        #: value by stamp, by sensor; of several with one stamp the first
        self.samples = {
            sensor: dict(zip(table.stamp_ns[::-1].tolist(), table.column(field)[::-1].tolist(), strict=True))
            for (sensor, (_, field)), table in zip(SENSOR_FIELDS.items(), sensors, strict=True)
        }
        self.samples["depth"] = {stamp_ns: mm_from_m(value) for stamp_ns, value in self.samples["depth"].items()}
        #: stamp and command, in order of receipt
        self.commands = _commands(self.messages.table("/fsw/command", _INPUTS))
        #: what the drives reported, by stamp
        self.drives = dict(_commands(self.messages.table("/fsw/drives", _INPUTS)))

    def parameters_changed(self, name: str) -> bool:
        """Whether a parameter of the controller's node was changed after its start."""
        table = self.messages.table("/parameter_events", {"node": "text"})
        own = table.column("node") == f"{self.messages.namespace}/fsw_{name}"
        return bool((own & (table.log_ns > self.proposals.log_ns[0])).any())


def _commands(table: Table) -> list[tuple[int, Command]]:
    columns = (table.stamp_ns, table.column("axial_force"), table.column("spindle_speed"))
    return [
        (stamp_ns, Command(kn_from_n(force), rpm_from_rad_s(speed)))
        for stamp_ns, force, speed in zip(*(values.tolist() for values in columns), strict=True)
        if math.isfinite(force) and math.isfinite(speed)
    ]
