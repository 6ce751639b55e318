"""Deterministic replay.

Drives a controller by a bag and compares its proposals with the recorded ones.

Time comes from the bag alone. At every tick the controller gets what its node had then: the
samples of that stamp, judged by the same sensor validity, the set-points in force and the command
applied before; in real time without what was sent only after the controller had answered the tick.
So the build that was recorded reproduces its proposals bit by bit on the same kind of processor,
and another build, tuning or controller shows where it first differs and by how much.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Generic, TypeVar

import numpy as np

from fsw_analysis.messages import SENSOR_TOPICS, Kind, Table, WeldMessages, stamp_of
from fsw_analysis.procedure import recorded_parameters
from fsw_analysis.signals import FIELDS, HELD, PLANNED, SENT, read_set_points, reasons, timeline
from fsw_analysis.weld_signals import SIMULATED_NS, experiment_time_s
from fsw_control.command_gate import NO_SET_POINT, answer
from fsw_control.common_parameters import hosted
from fsw_control.contract import Command, Controller, Proposal, Reference
from fsw_control.heat_plan import PlanInForce
from fsw_control.message_synchronizer import JUMP_NS
from fsw_control.parameters import ParameterModel, describe, validate
from fsw_control.ramps import ReferencePlan
from fsw_control.reason import Reason, ReasonCode
from fsw_control.sensors import REQUIRED
from fsw_control.units import (
    NANOSECONDS,
    kn_from_n,
    mm_from_m,
    n_from_kn,
    rad_s_from_rpm,
    rpm_from_rad_s,
)
from fsw_control.validity import SensorGuard, sensor_limits
from fsw_control.weld import TICK_NS, TICK_S
from fsw_recorder.errors import BagError

#: from the controller's parameters to the controller
Make = Callable[[dict[str, Any]], Controller]
#: force [N], speed [rad/s], and health with its reason where it is compared, too
Recorded = tuple[float, float, tuple[bool, Reason] | None]
Entry = TypeVar("Entry")

_INPUTS: dict[str, Kind] = {"axial_force": "number", "spindle_speed": "number"}
_PROPOSAL: dict[str, Kind] = {**_INPUTS, "healthy": "number"}


@dataclass(frozen=True, slots=True)
class TickDifference:
    """One tick at which the replayed proposal is not the recorded one."""

    tick: int  #: from the first replayed tick on
    time_s: float  #: on the scenario's clock; in real time the first replayed tick is at 0.1 s
    #: replayed minus recorded; NaN where one of both is not finite
    force_kn: float
    speed_rpm: float
    #: the larger difference, relative to 1 kN or 1 rpm plus the recorded value; infinite where one
    #: is not finite or something else differs
    size: float
    text: str = ""  #: what else differs (health and its reason); empty when only the numbers do


@dataclass(slots=True)
class Comparison:
    """Replayed proposals against recorded ones or applied commands."""

    title: str  #: what is compared
    ticks: int  #: ticks that both have
    #: in order of time; empty when all are equal bit by bit
    differences: list[TickDifference] = field(default_factory=list)
    tolerance: float = 0.0  #: size of a difference up to which proposals count as equal

    @property
    def identical(self) -> bool:
        """Whether all proposals are equal bit by bit."""
        return not self.differences

    @property
    def beyond(self) -> list[TickDifference]:
        """The differences that are larger than the tolerance."""
        return [item for item in self.differences if item.size > self.tolerance]

    def values(self) -> dict[str, Any]:
        """The result as plain values for JSON.

        Sizes of differences are absolute, and None without any.
        """
        first = next(iter(self.beyond), None)
        result: dict[str, Any] = {
            "title": self.title,
            "ticks": self.ticks,
            "differing": len(self.beyond),
            "first_tick": first and first.tick,
            "first_s": first and first.time_s,
        }
        for name in ("force_kn", "speed_rpm"):
            sizes = [(abs(getattr(item, name)), item.time_s) for item in self.differences]
            known = [size for size in sizes if math.isfinite(size[0])]
            largest, at_s = max(known, default=(0.0, None))
            mean = sum(size for size, _ in known) / max(self.ticks, 1)
            result[name] = {"largest": largest, "largest_s": at_s, "mean": mean}
        return result

    def lines(self) -> list[str]:
        """The result in words."""
        if self.identical:
            return [f"{self.title}: all {self.ticks} proposals reproduced bit by bit"]
        first = (self.beyond or self.differences)[0]
        what = f"{1e3 * first.force_kn:+.6g} N, {first.speed_rpm:+.6g} rpm" + (
            f", {first.text}" if first.text else ""
        )
        verdict = (
            f"all {self.ticks} proposals reproduced within the tolerance of "
            f"{self.tolerance:g} (1 + value)"
        )
        if self.beyond:
            verdict = f"{len(self.beyond)} of {self.ticks} proposals differ"
        force, speed = (self.values()[name] for name in ("force_kn", "speed_rpm"))
        return [
            f"{self.title}: {verdict}",
            f"first at tick {first.tick}, {first.time_s:.1f} s: {what} (replayed minus recorded)",
            f"largest: {1e3 * force['largest']:.6g} N, {speed['largest']:.6g} rpm; "
            f"mean: {1e3 * force['mean']:.6g} N, {speed['mean']:.6g} rpm",
        ]


@dataclass(slots=True)
class Replay:
    """A controller's new answers to the recorded measurements."""

    controller: str  #: its name
    parameters: dict[str, Any]  #: with which it ran, those of its node included
    #: stamp of each tick, and when its last sample had been received [ns]
    stamps: list[int]
    came: list[int]
    is_part: bool  #: whether only the first seconds of the weld were replayed
    time_s: list[float]  #: of each tick on the scenario's clock
    proposals: list[Proposal]  #: one per tick
    #: at each tick what the controller proposed when the bag was recorded, and what was applied
    own: list[Recorded | None]
    applied: list[Recorded | None]
    #: what may keep a replay from being exact (no parameters in the bag, parameters changed on the
    #: way, …)
    notes: list[str]
    #: false when the bag begins in mid-weld, or does not show in which order messages came
    comparable: bool

    def against_own(self, title: str, tolerance: float = 0.0) -> Comparison:
        """Compare with the controller's recorded proposals, if it took part in the weld."""
        return self._against(self.own, title, tolerance)

    def against_applied(self, title: str, tolerance: float = 0.0) -> Comparison:
        """Compare with the commands that were applied."""
        return self._against(self.applied, title, tolerance)

    def _against(
        self, recorded: Sequence[Recorded | None], title: str, tolerance: float
    ) -> Comparison:
        differences = []
        for tick, (time_s, proposal, was) in enumerate(
            zip(self.time_s, self.proposals, recorded, strict=True)
        ):
            differs = was and _difference(proposal, *was)
            if differs:
                differences.append(TickDifference(tick, time_s, *differs))
        return Comparison(title, sum(was is not None for was in recorded), differences, tolerance)


def replay(
    messages: WeldMessages,
    name: str,
    make: Make,
    described: ParameterModel = None,
    changed: Mapping[str, Any] | None = None,
    duration_s: float = math.inf,
) -> Replay:
    """Replay a weld to a controller.

    Parameters
    ----------
    messages : WeldMessages
        Of a bag with the sensor topics, commands and set-points.
    name : str
        The controller's name. Where the bag has its proposals, their ticks are replayed, else
        those of the sensors.
    make : callable
        Makes the controller from its parameters.
    described : class, optional
        Model of its parameters; their values are taken from the bag where it has them.
    changed : mapping, optional
        Parameters, on top of the recorded ones.
    duration_s : float, optional
        How much of the weld.

    Raises
    ------
    InputError
        A changed parameter is unknown or does not fit.
    BagError
        The bag lacks a topic, or the controller refuses its recorded parameters.
    """
    model = hosted(described)
    validate(model, changed or {})
    recorded = _Inputs(messages, name)
    values, notes = recorded.parameters(name)
    values |= changed or {}
    try:
        known = describe(model)
        settings = validate(model, {key: value for key, value in values.items() if key in known})
        controller = make({key: settings[key] for key in describe(described)})
    except Exception as error:  # a user's controller may fail in any way
        raise BagError(
            f"{messages.path}: controller {name} refuses its recorded parameters: {error}"
        ) from None
    references = recorded.set_points(notes)
    n = recorded.ticks_in(duration_s)
    stamps, came, time_s = (
        row[:n].tolist() for row in (recorded.stamps, recorded.came, recorded.time_s)
    )
    return Replay(
        controller=name,
        parameters=settings,
        stamps=stamps,
        came=came,
        is_part=n < recorded.stamps.size,
        time_s=time_s,
        proposals=recorded.show(controller, settings, references, stamps),
        own=recorded.own_rows()[:n],
        applied=recorded.applied_rows(stamps),
        comparable=recorded.comparable(name, notes),
        notes=notes,
    )


def _difference(
    proposal: Proposal, force_n: float, speed_rad_s: float, was: tuple[bool, Reason] | None
) -> tuple[float, float, float, str] | None:
    """Force [kN], speed [rpm], size and words by which a proposal differs from the recorded one.

    None if in nothing.
    """
    new_force_n, new_speed_rad_s = (
        n_from_kn(proposal.command.force_kn),
        rad_s_from_rpm(proposal.command.speed_rpm),
    )
    now = (proposal.healthy, Reason.of(proposal.reason))
    if (
        was is not None and was[1].code is ReasonCode.OTHER
    ):  # words, as of older bags, may be other ones today
        was = (was[0], now[1])
    text = "" if was in (None, now) else f"was {_health(*was or now)}, is {_health(*now)}"
    if _same(new_force_n, force_n) and _same(new_speed_rad_s, speed_rad_s) and not text:
        return None
    force_kn, speed_rpm = (
        kn_from_n(new_force_n - force_n),
        rpm_from_rad_s(new_speed_rad_s - speed_rad_s),
    )
    sizes = (
        abs(force_kn) / (1.0 + abs(kn_from_n(force_n))),
        abs(speed_rpm) / (1.0 + abs(rpm_from_rad_s(speed_rad_s))),
    )
    return (
        force_kn,
        speed_rpm,
        math.inf if text or not all(map(math.isfinite, sizes)) else max(sizes),
        text,
    )


def _same(first: float, second: float) -> bool:
    return first == second or (math.isnan(first) and math.isnan(second))


def _health(healthy: bool, reason: Reason) -> str:
    return ("healthy" if healthy else "not healthy") + (f" ({reason.words})" if reason else "")


@dataclass(frozen=True, slots=True)
class _Sent(Generic[Entry]):
    """A message's content, with when its sender sent it and when the recorder got it [ns]."""

    publish_ns: int
    log_ns: int
    value: Entry

    def after(self, answer: _Sent[None] | None) -> bool:
        """Whether it was sent after an answer.

        Both times must agree: clocks of two computers differ, and a recorder that was stalled
        receives in any order.
        """
        return (
            answer is not None
            and self.publish_ns > answer.publish_ns
            and self.log_ns > answer.log_ns
        )


def _read_plans(messages: WeldMessages) -> list[tuple[int, tuple[int, ReferencePlan]]]:
    """Plans that announced set-points, with receive time and stamp [ns], in that order.

    Without those that are refused.
    """
    plans: list[tuple[int, tuple[int, ReferencePlan]]] = []
    for log_ns, _, plan in messages.decoded(PLANNED):
        points = [
            (stamp_of(goal), Reference(mm_from_m(goal.depth), float(goal.temperature)))
            for goal in getattr(plan, "references", ())
        ]
        if all(before < after for (before, _), (after, _) in pairwise(points)):
            plans.append((log_ns, (stamp_of(plan), ReferencePlan(points))))
    return plans


class _Inputs:
    """The content of a bag for the replay of one controller."""

    def __init__(self, messages: WeldMessages, name: str) -> None:
        self._messages = messages
        sensors = messages.sensors()
        self._sent, self._held = (read_set_points(messages, topic) for topic in (SENT, HELD))
        missing = [SENSOR_TOPICS[name] for name in REQUIRED if not sensors[name][0]]
        missing += [] if self._sent or self._held else [SENT]
        if missing:
            raise BagError(f"{messages.path}: cannot be replayed, it has no {', '.join(missing)}")
        self._own = messages.table(
            f"/fsw/{name}/proposal", _PROPOSAL, FIELDS
        ).without_repetitions()
        self._stated = read_set_points(messages, f"/fsw/{name}/reference")
        self._plans = _read_plans(messages)
        #: stamp and command, in order of receipt
        self._commands = _commands(messages.table("/fsw/command", _INPUTS))
        #: what the drives reported, by stamp
        self._drives = {
            stamp_ns: sent.value
            for stamp_ns, sent in _commands(messages.table("/fsw/drives", _INPUTS))
        }
        #: value by stamp, by sensor; of several with one stamp the first
        self._samples: dict[str, dict[int, _Sent[float]]] = {}
        received: dict[int, int] = {}
        for sensor, (table, values) in sensors.items():
            samples = list(_sent(table, values.tolist()))
            self._samples[sensor] = dict(reversed(samples))
            for stamp_ns, sent in samples:
                received[stamp_ns] = max(sent.log_ns, received.get(stamp_ns, sent.log_ns))
        self.stamps = self._own.stamp_ns if self._own else np.array(sorted(received), np.int64)
        self.time_s = experiment_time_s(self.stamps)
        answered = self._own.log_ns.tolist() if self._own else [0] * len(self.stamps)
        #: the proposal of each tick, after which nothing could be known any more; in lockstep
        #: nothing comes so late
        self._answers: list[_Sent[None] | None] = [None] * len(self.stamps)
        if self._own and self.stamps[0] > SIMULATED_NS:
            self._answers = [sent for _, sent in _sent(self._own, [None] * len(self.stamps))]
        #: when the last sample of each tick had been received; of one without samples the proposal
        self.came = np.array(
            [received.get(*key) for key in zip(self.stamps.tolist(), answered, strict=True)],
            np.int64,
        )

    def ticks_in(self, duration_s: float) -> int:
        """Number of ticks in the first seconds of the weld."""
        if duration_s == math.inf:
            return self.stamps.size
        end_ns = self.stamps[0] + round((duration_s - 0.5 * TICK_S) * NANOSECONDS)
        return int(np.searchsorted(self.stamps, end_ns))

    def parameters(self, name: str) -> tuple[dict[str, Any], list[str]]:
        """Recorded parameters of the controller's node, with notes.

        Without them it begins at the first command.
        """
        notes = []
        try:
            values = recorded_parameters(
                self._messages.attachments, self._messages.namespace, name
            )
        except BagError as error:
            notes.append(f"{error}; its defaults are used")
            first = next((sent.value for _, sent in self._commands), None)
            values = (
                {"initial_force": first.force_kn, "initial_speed": first.speed_rpm}
                if first
                else {}
            )
        changes = self._messages.table("/parameter_events", {"node": "text"})
        own = changes.column("node") == f"{self._messages.namespace}/fsw_{name}"
        if self._own and bool((own & (changes.log_ns > self._own.log_ns[0])).any()):
            notes.append(
                f"parameters of {name} were changed at runtime; the replay uses the initial ones"
            )
        return values, notes

    def comparable(self, name: str, notes: list[str]) -> bool:
        """Whether the bag shows all that the controller knew.

        From its start on, and in which order.
        """
        before = any(0 < item.stamp_ns < self.stamps[0] for item in self._stated[:1])
        if before:  # the first set-points that it reports are older
            notes.append(
                f"the bag begins in mid-weld: the state of {name} then is unknown, "
                "its proposals may differ"
            )
        back = bool((np.diff(self.stamps) < 0).any())
        if back:
            notes.append(
                "the stamps go back: the plant was started again, or the receive times are wrong"
            )
        return not (before or back)

    def set_points(self, notes: list[str]) -> list[tuple[int, Reference]]:
        """Set-points with the stamp of the tick from which the controller reports to follow each.

        Where the bag lacks these reports, those count that were received before the samples of a
        tick; the proposal is no measure, because it is later by the solve time.
        """
        known = {
            (round(row.depth_mm, 9), row.temperature_c): row.reference
            for row in (*self._sent, *self._held)
        }
        # a conversion on the wire may change the last bit
        points = [
            (row.stamp_ns, known.get((round(row.depth_mm, 9), row.temperature_c), row.reference))
            for row in self._stated
        ]
        waited = bool(self._own) and reasons(self._own)[0] == NO_SET_POINT
        if not points or (points[0][0] > self.stamps[0] and not waited):
            sent = timeline(self._sent, self._held, self.stamps, self.came, notes)
            points = [*(point for point in sent if not points or point[0] < points[0][0]), *points]
        if self._by_hand():
            what = "what announces them" if self._stated else "they, and what announces them,"
            notes.append(
                f"set-points were sent by hand in real time: when {what} reached the controller, "
                "the bag does not show exactly; proposals after one may differ"
            )
        return points

    def _by_hand(self) -> bool:
        """Whether set-points arrived in real time with immediate effect, not ahead of time."""
        coming = [
            row for row in self._sent if self.came[0] > SIMULATED_NS and row.log_ns > self.came[0]
        ]
        newest = self.stamps[
            np.searchsorted(self.came, [row.log_ns for row in coming]) - 1
        ].tolist()
        return any(
            row.stamp_ns <= stamp + TICK_NS for row, stamp in zip(coming, newest, strict=True)
        )

    def show(
        self,
        controller: Controller,
        settings: Mapping[str, Any],
        references: Iterable[tuple[int, Reference]],
        stamps: Sequence[int],
    ) -> list[Proposal]:
        """The controller's proposals for the recorded measurements."""
        guard = SensorGuard(sensor_limits(settings))
        applied = Command(settings["initial_force"], settings["initial_speed"])
        controller.reset(applied)
        waiting: deque[tuple[int, Reference | None]] = deque(references)
        plans, commands = deque(self._plans), deque(self._commands)
        reference: Reference | None = None
        in_force, last_ns = PlanInForce(ReferencePlan()), None
        proposals: list[Proposal] = []
        for stamp_ns, came_ns, answer_sent in zip(
            stamps, self.came.tolist(), self._answers, strict=False
        ):
            reference = _latest(waiting, stamp_ns, reference)
            while plans and plans[0][0] <= came_ns:
                in_force.receive(*plans.popleft()[1])
            plan = in_force.at(stamp_ns)
            while commands and commands[0][0] < stamp_ns and not commands[0][1].after(answer_sent):
                applied = commands.popleft()[1].value
            if last_ns is not None and not 0 < stamp_ns - last_ns <= JUMP_NS:
                guard.reset()
                controller.reset(applied)
                last_ns = None
            dt_s = settings["period"] if last_ns is None else (stamp_ns - last_ns) / NANOSECONDS
            last_ns = stamp_ns
            sent = {sensor: samples.get(stamp_ns) for sensor, samples in self._samples.items()}
            values = {
                sensor: sample.value
                for sensor, sample in sent.items()
                if sample and not sample.after(answer_sent)
            }
            measurement = guard.measure(stamp_ns * 1e-9, values, self._drives.get(stamp_ns))
            followed = reference and replace(reference, coming=plan.after(stamp_ns, reference))
            proposals.append(answer(controller, measurement, followed, applied, dt_s))
        return proposals

    def own_rows(self) -> list[Recorded | None]:
        """The controller's recorded proposal of each tick."""
        if not self._own:
            return [None] * len(self.stamps)
        columns = (self._own.column(path).tolist() for path in _PROPOSAL)
        rows = zip(*columns, reasons(self._own), strict=True)
        return [(force, speed, (bool(healthy), reason)) for force, speed, healthy, reason in rows]

    def applied_rows(self, stamps: Iterable[int]) -> list[Recorded | None]:
        """The command applied in each tick.

        Of several commands with one stamp the first, as in the plant.
        """
        commands = {stamp_ns: sent.value for stamp_ns, sent in reversed(self._commands)}
        applied = (commands.get(stamp_ns) for stamp_ns in stamps)
        return [
            cmd and (n_from_kn(cmd.force_kn), rad_s_from_rpm(cmd.speed_rpm), None)
            for cmd in applied
        ]


def _latest(waiting: deque[tuple[int, Entry]], until_ns: int, present: Entry) -> Entry:
    """Take the entries up to a time out of the queue.

    The last of them, or else the present one.
    """
    while waiting and waiting[0][0] <= until_ns:
        _, present = waiting.popleft()
    return present


def _sent(table: Table, values: Sequence[Entry]) -> Iterator[tuple[int, _Sent[Entry]]]:
    columns = (table.stamp_ns.tolist(), table.publish_ns.tolist(), table.log_ns.tolist(), values)
    for stamp_ns, publish_ns, log_ns, value in zip(*columns, strict=True):
        yield stamp_ns, _Sent(publish_ns, log_ns, value)


def _commands(table: Table) -> list[tuple[int, _Sent[Command]]]:
    columns = (table.column(name).tolist() for name in ("axial_force", "spindle_speed"))
    commands = [
        Command(kn_from_n(force), rpm_from_rad_s(speed))
        for force, speed in zip(*columns, strict=True)
    ]
    return [
        entry
        for entry in _sent(table, commands)
        if math.isfinite(entry[1].value.force_kn) and math.isfinite(entry[1].value.speed_rpm)
    ]
