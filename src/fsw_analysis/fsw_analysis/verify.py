"""Deterministic replay: drives a controller from a bag and compares its proposals with the recorded ones.

Time comes from the bag alone. At every recorded proposal the controller gets what its node had then: the samples of
that stamp, judged by the same sensor validity, the set-points in force and the command applied before. So the build
that was recorded reproduces its proposals bit by bit on the same kind of processor, and another build shows where it
first differs and by how much.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fsw_analysis.columns import Kind
from fsw_analysis.messages import SENSOR_FIELDS, Table, WeldMessages, recorded_parameters
from fsw_analysis.set_points import HELD, SENT, followed, read_plans, read_set_points, timeline
from fsw_analysis.weld_signals import experiment_time_s
from fsw_control.contract import Command, Controller, Proposal, Reference
from fsw_control.host import NO_SET_POINT, answer
from fsw_control.parameters import Source, load_source, validate
from fsw_control.references import ReferencePlan
from fsw_control.units import NANOSECONDS, kn_from_n, mm_from_m, n_from_kn, rad_s_from_rpm, rpm_from_rad_s
from fsw_control.validity import SensorGuard, sensor_limits
from fsw_control.weld import TICK_S
from fsw_recorder.errors import BagError

#: from the controller's recorded parameters to the controller
Make = Callable[[dict[str, Any]], Controller]
Entry = TypeVar("Entry")

#: a longer pause of the measurements is a restart of time, as for the controller's node
_JUMP_NS = NANOSECONDS
_TICK_NS = round(TICK_S * NANOSECONDS)
#: times above this are of the wall clock
_REAL_TIME_NS = NANOSECONDS * 10**8
_INPUTS: dict[str, Kind] = {"axial_force": "number", "spindle_speed": "number"}
_PROPOSAL: dict[str, Kind] = {**_INPUTS, "healthy": "number", "reason": "text"}


@dataclass(frozen=True, slots=True)
class TickDifference:
    """One tick at which the replayed proposal is not the recorded one.

    Attributes
    ----------
    tick : int
        From the first recorded proposal on.
    time_s : float
        On the scenario's clock; in real time the first recorded proposal is at 0.1 s.
    force_kn, speed_rpm : float
        Replayed minus recorded; NaN where one of both is not finite.
    size : float
        The larger difference, relative to 1 kN or 1 rpm plus the recorded value; infinite where one is not finite or
        something else differs.
    text : str
        What else differs (health and its reason); empty when only the numbers do.
    """

    tick: int
    time_s: float
    force_kn: float
    speed_rpm: float
    size: float
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
    tolerance : float
        Size of a difference up to which proposals count as equal.
    notes : list of str
        What may keep a replay from being exact (no parameters in the bag, parameters changed on the way, …).
    comparable : bool
        False when the bag begins in mid-weld, so that the controller's state then is unknown.
    """

    controller: str
    ticks: int
    differences: list[TickDifference] = field(default_factory=list)
    tolerance: float = 0.0
    notes: list[str] = field(default_factory=list)
    comparable: bool = True

    @property
    def identical(self) -> bool:
        """Whether all proposals are equal bit by bit."""
        return not self.differences

    @property
    def beyond(self) -> list[TickDifference]:
        """The differences that are larger than the tolerance."""
        return [one for one in self.differences if one.size > self.tolerance]

    def lines(self) -> list[str]:
        """The result in words, without the notes."""
        if self.identical:
            return [f"{self.controller}: all {self.ticks} proposals reproduced bit by bit"]
        first = (self.beyond or self.differences)[0]
        what = f"{1e3 * first.force_kn:+.6g} N, {first.speed_rpm:+.6g} rpm" + (f", {first.text}" if first.text else "")
        force = max((abs(one.force_kn) for one in self.differences if not math.isnan(one.force_kn)), default=0.0)
        speed = max((abs(one.speed_rpm) for one in self.differences if not math.isnan(one.speed_rpm)), default=0.0)
        told = f"all {self.ticks} proposals reproduced within the tolerance of {self.tolerance:g}"
        if self.beyond:
            told = f"{len(self.beyond)} of {self.ticks} proposals differ"
        return [
            f"{self.controller}: {told}",
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


def verify(path: Path | str, name: str, make: Make, parameters: Source = None, tolerance: float = 0.0) -> Verification:
    """Replay a controller on a bag and compare.

    Parameters
    ----------
    path : Path or str
        Bag with the sensor topics, commands, set-points and the controller's proposals.
    name : str
        The controller's name in the bag.
    make : callable
        Makes the controller from its parameters.
    parameters : (str, str) or path, optional
        Where its parameters are described; their values are taken from the bag where it has them.
    tolerance : float
        See `Verification.tolerance`.

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
        controller = make(_validated(parameters, values))
    except Exception as error:  # a user's controller may fail in any way
        raise BagError(f"{path}: controller {name} refuses its recorded parameters: {error}") from None
    if recorded.parameters_changed(name):
        notes.append(f"parameters of {name} were changed while it ran; the replay keeps the first ones")
    proposals = recorded.proposals
    references = recorded.set_points(notes)
    differences = _replay(recorded, references, controller, settings)
    return Verification(name, len(proposals), differences, tolerance, notes, not recorded.in_mid_weld(name, notes))


def _validated(described: Source, recorded: Mapping[str, Any]) -> dict[str, Any]:
    specs = load_source(described)
    return validate(specs, {key: value for key, value in recorded.items() if key in specs})


def _replay(
    recorded: _Recorded, references: list[tuple[int, Reference]], controller: Controller, settings: dict[str, Any]
) -> list[TickDifference]:
    """Differences of the controller's new answers to the recorded measurements."""
    guard = SensorGuard(sensor_limits(settings))
    applied = Command(settings["initial_force"], settings["initial_speed"])
    controller.reset(applied)
    stamps: list[int] = recorded.proposals.stamp_ns.tolist()
    time_s = experiment_time_s(recorded.proposals.stamp_ns).tolist()
    columns = [recorded.proposals.column(path).tolist() for path in _PROPOSAL]
    waiting: deque[tuple[int, Reference | None]] = deque(references)
    plans, plan = deque(recorded.plans), ReferencePlan()
    commands = deque(recorded.commands)
    reference: Reference | None = None
    last_ns: int | None = None
    differences: list[TickDifference] = []
    for tick, (stamp_ns, *was) in enumerate(zip(stamps, *columns, strict=True)):
        reference = _latest(waiting, stamp_ns, reference)
        plan = _latest(plans, recorded.came_ns.get(stamp_ns, 0), plan)
        applied = _latest(commands, stamp_ns - 1, applied)
        if last_ns is not None and not 0 < stamp_ns - last_ns <= _JUMP_NS:
            guard.reset()
            controller.reset(applied)
            last_ns = None
        dt_s = settings["period"] if last_ns is None else (stamp_ns - last_ns) / NANOSECONDS
        last_ns = stamp_ns
        values = {sensor: samples[stamp_ns] for sensor, samples in recorded.samples.items() if stamp_ns in samples}
        measurement = guard.measure(stamp_ns * 1e-9, values, recorded.drives.get(stamp_ns))
        followed_now = reference and replace(reference, coming=plan.after(stamp_ns, reference))
        difference = _compare(answer(controller, measurement, followed_now, applied, dt_s), *was)
        if difference is not None:
            differences.append(TickDifference(tick, time_s[tick], *difference))
    return differences


def _latest(waiting: deque[tuple[int, Entry]], until_ns: int, present: Entry) -> Entry:
    """Take the entries up to a time out of the queue; the last of them, or else the present one."""
    while waiting and waiting[0][0] <= until_ns:
        _, present = waiting.popleft()
    return present


def _compare(
    proposal: Proposal, force_n: float, speed_rad_s: float, healthy: float, reason: str
) -> tuple[float, float, float, str] | None:
    """Force [kN], speed [rpm], size and words by which a proposal differs from the recorded one; None if in nothing."""
    new_force_n, new_speed_rad_s = n_from_kn(proposal.command.force_kn), rad_s_from_rpm(proposal.command.speed_rpm)
    was, now = (bool(healthy), reason), (proposal.healthy, proposal.reason)
    text = "" if was == now else f"was {_health(*was)}, is {_health(*now)}"
    if _same(new_force_n, force_n) and _same(new_speed_rad_s, speed_rad_s) and not text:
        return None
    force_kn, speed_rpm = kn_from_n(new_force_n - force_n), rpm_from_rad_s(new_speed_rad_s - speed_rad_s)
    sizes = (abs(force_kn) / (1.0 + abs(kn_from_n(force_n))), abs(speed_rpm) / (1.0 + abs(rpm_from_rad_s(speed_rad_s))))
    return force_kn, speed_rpm, math.inf if text or not all(map(math.isfinite, sizes)) else max(sizes), text


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
        self.stated = read_set_points(self.messages, f"/fsw/{name}/reference")
        missing = [topic for topic, table in zip([*topics, own], [*sensors, self.proposals], strict=True) if not table]
        missing += [] if self.sent or self.held else [SENT]
        if missing:
            raise BagError(f"{path}: cannot be replayed, it has no {', '.join(missing)}")
        #: value by stamp, by sensor; of several with one stamp the first
        self.samples = {
            sensor: dict(zip(table.stamp_ns[::-1].tolist(), table.column(field)[::-1].tolist(), strict=True))
            for (sensor, (_, field)), table in zip(SENSOR_FIELDS.items(), sensors, strict=True)
        }
        #: when the last sample of a stamp had been received
        self.came_ns: dict[int, int] = {}
        for table in sensors:
            for stamp_ns, log_ns in zip(table.stamp_ns.tolist(), table.log_ns.tolist(), strict=True):
                self.came_ns[stamp_ns] = max(log_ns, self.came_ns.get(stamp_ns, log_ns))
        self.samples["depth"] = {stamp_ns: mm_from_m(value) for stamp_ns, value in self.samples["depth"].items()}
        #: stamp and command, in order of receipt
        self.commands = _commands(self.messages.table("/fsw/command", _INPUTS))
        self.plans = read_plans(self.messages)
        #: what the drives reported, by stamp
        self.drives = dict(_commands(self.messages.table("/fsw/drives", _INPUTS)))

    def steered_by_hand(self) -> bool:
        """Whether set-points came in real time for the present tick or at once, not ahead as a programme sends them."""
        logs, stamps = self.proposals.log_ns, self.proposals.stamp_ns
        coming = [one for one in self.sent if logs[0] > _REAL_TIME_NS and one.log_ns > logs[0]]
        newest = stamps[np.searchsorted(logs, [one.log_ns for one in coming]) - 1].tolist()
        return any(one.stamp_ns <= stamp + _TICK_NS for one, stamp in zip(coming, newest, strict=True))

    def in_mid_weld(self, name: str, notes: list[str]) -> bool:
        """Whether the controller had answered before the bag begins: it states set-points that it followed before."""
        before = any(0 < one.stamp_ns < self.proposals.stamp_ns[0] for one in self.stated[:1])
        if before:
            notes.append(f"the bag begins in mid-weld: the state of {name} then is unknown, its proposals may differ")
        return before

    def set_points(self, notes: list[str]) -> list[tuple[int, Reference]]:
        """Set-points with the stamp of the tick from which the controller followed each, as it states itself.

        Where the bag lacks that, those hold that had come when the samples of a tick had: the proposal, which is later
        by the time of the solution, is too late to judge by.
        """
        stamps = self.proposals.stamp_ns
        answered = zip(stamps.tolist(), self.proposals.log_ns.tolist(), strict=True)
        came = np.array([self.came_ns.get(stamp_ns, log_ns) for stamp_ns, log_ns in answered])
        stated = self.stated
        points = followed(stated, [*self.sent, *self.held])
        if not stated or (stated[0].stamp_ns > stamps[0] and self.proposals.column("reason")[0] != NO_SET_POINT):
            begin_ns = stated[0].stamp_ns if stated else stamps[-1] + 1
            sent = timeline(self.sent, self.held, stamps, came, notes)
            points = [*(one for one in sent if one[0] < begin_ns), *points]
        if self.steered_by_hand():
            what = "what announces them" if stated else "they, and what announces them,"
            notes.append(
                f"set-points were sent by hand in real time: when {what} reached the controller, the bag does not show "
                "exactly; proposals after one may differ"
            )
        return points

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
