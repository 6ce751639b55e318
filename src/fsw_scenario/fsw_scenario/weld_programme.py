"""The programme of a whole weld: phases along the tool's path, and their state machine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import accumulate
from math import nan, pi, sqrt
from typing import Annotated, Literal, Self, get_args

from pydantic import Field, model_validator

from fsw_control.coded import Answer, Fact, Worded
from fsw_control.contract import Reference
from fsw_control.ranges import (
    REFERENCE_DEPTH_MM,
    REFERENCE_TEMPERATURE_C,
    WELD_RATE_DEPTH_MM_PER_S,
    WELD_RATE_TEMPERATURE_C_PER_S,
)
from fsw_control.schema.models import Many, Model, needs_one, problem, without_default
from fsw_control.schema.ranges import Range
from fsw_control.weld import TICK_S
from fsw_plant.event_schema import DURATION_S, TIME_S
from fsw_plant.tool_path import Waypoint

#: Diameter of the joint line: about 1 m in the paper; with 1.05 m at 86 mm/min a turn takes the
#: published 38 to 40 min.
CANISTER_DIAMETER_MM = 1050.0
#: arc length of one degree
MM_PER_DEG = pi * CANISTER_DIAMETER_MM / 360.0
PhaseName = Literal["dwell", "start", "downward", "joint_line", "overlap", "parking"]
#: phases of a weld in order; each may be omitted
PHASES: tuple[PhaseName, ...] = get_args(PhaseName)
ANGLE_DEG, LENGTH_MM = Range(0.0, 720.0, "deg"), Range(0.0, 10_000.0, "mm")
#: age of the thermocouple sample that decides, so that it has arrived in the graph, too (chosen)
READING_AGE_TICKS = 2
#: ticks for which `until_c` must be reached, so that noise does not end the phase (chosen)
_WARM_TICKS = 10
#: larger differences between tick numbers mean that the clock has jumped
_CLOCK_JUMP_TICKS = 100


class SetPointEntry(Model):
    """New set-points; an omitted one keeps its value."""

    depth_mm: Annotated[float, REFERENCE_DEPTH_MM] | None = None
    temperature_c: Annotated[float, REFERENCE_TEMPERATURE_C] | None = None
    over_s: Annotated[float, TIME_S] = 0.0
    """duration of a ramp to them; 0: a step"""

    @model_validator(mode="after")
    def _check_any(self) -> Self:
        return needs_one(self, "depth_mm", "temperature_c")


class PhaseSetPoint(SetPointEntry):
    """New set-points in a phase; an omitted one keeps its value."""

    at_s: Annotated[float, TIME_S] = 0.0
    """time from the phase's start"""


class Phase(Model):
    """A part of the weld: of a given duration, or with travel between two angles of the path."""

    name: PhaseName
    """in this order; each may be omitted"""
    duration_s: Annotated[float, DURATION_S] = Field(0.0, json_schema_extra=without_default)
    """of a phase without travel"""
    until_c: Annotated[float, REFERENCE_TEMPERATURE_C] | None = None
    """in a `dwell` without travel: it ends once the thermocouple has shown at least this
    temperature for 1 s, in a ramp of the set-point by a step to the ramp's end; `duration_s` is
    then its longest duration"""
    to_deg: Annotated[float, ANGLE_DEG] = Field(0.0, json_schema_extra=without_default)
    """end of a phase with travel"""
    from_deg: Annotated[float, ANGLE_DEG] = Field(0.0, json_schema_extra=without_default)
    """start of a phase with travel; default: the end of the previous phase"""
    length_mm: Annotated[float, LENGTH_MM] = Field(0.0, json_schema_extra=without_default)
    """of the path; default: the arc on the canister, which is the minimum"""
    speed_mm_per_min: Annotated[float, Range(10.0, 300.0, "mm/min")] = 86.0
    """traverse speed; the default is the paper's, section II"""
    set_points: Many[PhaseSetPoint] = ()

    @model_validator(mode="after")
    def _check_travel(self) -> Self:
        moving = [
            key
            for key in ("from_deg", "length_mm", "speed_mm_per_min")
            if key in self.model_fields_set
        ]
        duration, travel = (key in self.model_fields_set for key in ("duration_s", "to_deg"))
        if moving and not travel:
            raise ValueError(f"has {', '.join(moving)} but no to_deg")
        if self.until_c is not None and (travel or self.name != "dwell"):
            raise ValueError("has until_c; only a dwell without travel waits for a temperature")
        if duration and travel:
            raise ValueError(
                "has duration_s and to_deg; the duration of a path follows from its speed"
            )
        if not duration and not travel:
            raise ValueError("lacks duration_s or, with travel, to_deg")
        return self


class State(StrEnum):
    """State of the programme."""

    RUNNING = "running"
    HELD = "held"
    ABORTED = "aborted"
    DONE = "done"


class ProgrammeCode(Worded):
    """State of a programme, and answers to requests for another one."""

    AT = "{state} in phase {phase} at {angle_deg:.1f} deg"
    AT_TIME = "{state} at {time_s:.1f} s"
    NOT_POSSIBLE = "the weld is {state}; it must be {allowed}"
    FOLLOWED = "the programme's set-points are in force"
    WAY_BACK = (
        "set-points from {start_mm:.4g} mm, {start_c:.5g} degC back to the programme's "
        "{goal_mm:.4g} mm, {goal_c:.5g} degC by a ramp over {duration_s:.1f} s"
    )
    RESUMED = "{at.words}; {way.words}"
    NO_PHASES = "{scenario} has no phases, so it cannot be held; to end it, abort it"
    NO_WELD = "no weld is under way"


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a programme; ``time_left_s`` is without holds."""

    state: State
    phase: str
    angle_deg: float
    length_mm: float
    time_left_s: float


def spans(phases: Sequence[Phase], whole_s: float | None = None) -> list[tuple[str, float, float]]:
    """Name, start and end of each phase [s], as planned, or shortened to a weld of ``whole_s``."""
    lengths = [phase.duration_s for phase in phases]
    if whole_s is not None and phases[0].until_c is not None:
        lengths[0] -= max(sum(lengths) - whole_s, 0.0)
    ends = list(accumulate(lengths))
    return [
        (phase.name, end - length, end)
        for phase, length, end in zip(phases, lengths, ends, strict=True)
    ]


def time_at(phases: Sequence[Phase], angle_deg: float) -> float:
    """Time at which the tool first passes an angle of the path [s]."""
    for phase, (_, begin_s, end_s) in zip(phases, spans(phases), strict=True):
        if phase.from_deg <= angle_deg <= phase.to_deg > phase.from_deg:
            return begin_s + (end_s - begin_s) * (angle_deg - phase.from_deg) / (
                phase.to_deg - phase.from_deg
            )
    return 0.0  # a weld without travel


class PhaseMachine:
    """Runs through the phases tick by tick; can be held, resumed and aborted.

    ``tick`` counts the programme's ticks so far; ``held`` is the lead of the process's tick
    number: ticks of holds and clock jumps, less those by which phases ended early because their
    temperature was reached. ``n_ticks`` are those of the scenario, by default of the phases.
    """

    def __init__(self, phases: Sequence[Phase], n_ticks: int = 0) -> None:
        self.phases = tuple(phases)
        self._spans = spans(phases)
        self._n_ticks = n_ticks or round(self._spans[-1][2] / TICK_S)
        self.tick = self.held = self._warm_ticks = 0
        self.state = State.RUNNING

    def follow(self, number: int, temperature_c: float = nan) -> bool:
        """Take the number of the process's tick (the first is 1) and the thermocouple's reading.

        Returns whether the programme has jumped to the end of a phase because its temperature is
        reached. A number that is old or from another clock does no harm.
        """
        passed = number - self.tick - self.held
        if abs(passed) > _CLOCK_JUMP_TICKS:
            self.held, passed = self.held + passed - 1, 1
        if self.state is not State.RUNNING:
            self.held += max(passed, 0)
        else:
            self.tick = min(self.tick + max(passed, 0), self._n_ticks)
            jumped = passed > 0 and bool(self.phases) and self._jump(temperature_c)
            if self.tick == self._n_ticks:
                self.state = State.DONE
            return jumped
        return False

    def _jump(self, temperature_c: float) -> bool:
        """Go to the end of a phase whose temperature is reached."""
        phase, begin_s, end_s = self._present()
        warm = (
            begin_s < self.tick * TICK_S
            and phase.until_c is not None
            and temperature_c >= phase.until_c
        )
        self._warm_ticks = self._warm_ticks + 1 if warm else 0
        if self._warm_ticks < _WARM_TICKS:
            return False
        self._warm_ticks = 0
        left = round(end_s / TICK_S) - self.tick
        self.tick, self.held = self.tick + left, self.held - left
        return left > 0

    def _present(self) -> tuple[Phase, float, float]:
        """The present phase, its start and its end."""
        parts = [(phase, *span[1:]) for phase, span in zip(self.phases, self._spans, strict=True)]
        return next((part for part in parts if self.tick * TICK_S < part[2]), parts[-1])

    def hold(self) -> Answer:
        """Stop the travel."""
        return self._go(State.HELD, (State.RUNNING,))

    def resume(self) -> Answer:
        """Continue after a hold."""
        return self._go(State.RUNNING, (State.HELD,))

    def abort(self) -> Answer:
        """Abort the weld."""
        return self._go(State.ABORTED, (State.RUNNING, State.HELD))

    def _go(self, state: State, allowed: Sequence[State]) -> Answer:
        if self.state not in allowed:
            must = " or ".join(allowed)
            return Answer.refused(ProgrammeCode.NOT_POSSIBLE, state=self.state, allowed=must)
        self.state = state
        return Answer(True, self.describe())

    def describe(self) -> Fact:
        """State, phase and angle; without phases the time."""
        if not self.phases:
            time_s = self.tick * TICK_S
            return Fact.of(ProgrammeCode.AT_TIME, state=self.state, time_s=time_s)
        at = self.progress()
        return Fact.of(ProgrammeCode.AT, state=at.state, phase=at.phase, angle_deg=at.angle_deg)

    def progress(self) -> Progress:
        """Present progress."""
        time_s, length_mm = self.tick * TICK_S, 0.0
        left_s = (self._n_ticks - self.tick) * TICK_S
        if not self.phases:
            return Progress(self.state, "", 0.0, 0.0, left_s)
        for phase, (_, begin_s, end_s) in zip(self.phases, self._spans, strict=True):
            share = min((time_s - begin_s) / phase.duration_s, 1.0)
            if time_s < end_s or phase is self.phases[-1]:
                break
            length_mm += phase.length_mm
        angle_deg = phase.from_deg + share * (phase.to_deg - phase.from_deg)
        return Progress(
            self.state, phase.name, angle_deg, length_mm + share * phase.length_mm, left_s
        )


#: unit, largest step (chosen) and largest rate of the set-points
LIMITS = {
    "depth_mm": ("mm", 0.2, WELD_RATE_DEPTH_MM_PER_S),
    "temperature_c": ("degC", 10.0, WELD_RATE_TEMPERATURE_C_PER_S),
}


def joined(entries: Sequence[Phase]) -> tuple[Phase, ...]:
    """The phases in sequence, with all omitted values filled in."""
    if not entries:
        raise problem(f"is empty; some of {', '.join(PHASES)}", "phases")
    phases: list[Phase] = []
    for i, entry in enumerate(entries):
        at = ("phases", i)
        if phases and PHASES.index(entry.name) <= PHASES.index(phases[-1].name):
            raise problem(
                f"{entry.name} cannot follow {phases[-1].name}; the order is {', '.join(PHASES)}",
                *at,
            )
        here_deg = phases[-1].to_deg if phases else 0.0
        keys = entry.model_fields_set
        if "to_deg" not in keys:
            phases.append(entry.model_copy(update={"from_deg": here_deg, "to_deg": here_deg}))
            continue
        if "from_deg" in keys and entry.from_deg != here_deg:
            raise problem(
                f"= {entry.from_deg:g} jumps: the previous phase ends at {here_deg:g} deg",
                *at,
                "from_deg",
            )
        _check(entry.to_deg, Range(here_deg, ANGLE_DEG.high, "deg"), *at, "to_deg")
        arc_mm = (entry.to_deg - here_deg) * MM_PER_DEG
        length_mm = entry.length_mm if "length_mm" in keys else arc_mm
        _check(length_mm, Range(arc_mm, LENGTH_MM.high, "mm"), *at, "length_mm")
        if length_mm <= 0.0:
            raise problem(
                "has a path without length; give duration_s for a phase without travel", *at
            )
        duration_s = length_mm / entry.speed_mm_per_min * 60.0
        complete = {"from_deg": here_deg, "length_mm": length_mm, "duration_s": duration_s}
        phases.append(entry.model_copy(update=complete))
    return tuple(phases)


def tool_path(phases: Sequence[Phase]) -> tuple[Waypoint, ...]:
    """Positions of the tool at the ends of the phases.

    If the path of ``downward`` or ``parking`` is longer than its arc, the excess leads down to the
    joint line or up.
    """
    climb = {"downward": -1.0, "parking": 1.0}
    points, time_s, arc_mm, axial_mm = [(0.0, 0.0, 0.0)], 0.0, 0.0, 0.0
    line_mm = 0.0  # the joint line, seen from the start
    for phase in phases:
        arc = (phase.to_deg - phase.from_deg) * MM_PER_DEG
        time_s, arc_mm = time_s + phase.duration_s, arc_mm + arc
        axial_mm += climb.get(phase.name, 0.0) * sqrt(max(phase.length_mm**2 - arc**2, 0.0))
        line_mm = axial_mm if phase.name == "downward" else line_mm
        points.append((time_s, arc_mm, axial_mm))
    # rounded, as in the text of the scenario
    return tuple(
        Waypoint(at_s=round(at_s, 3), arc_mm=round(arc, 3), axial_mm=round(axial - line_mm, 3))
        for at_s, arc, axial in points
    )


def set_points(phases: Sequence[Phase], start: Reference) -> Iterator[tuple[float, PhaseSetPoint]]:
    """Set-points of phases with times from the weld's start; ``start`` precedes the first."""
    present = {name: getattr(start, name) for name in LIMITS}
    begin_s = 0.0
    for i, phase in enumerate(phases):
        free_s = 0.0
        for k, point in enumerate(phase.set_points):
            at = ("phases", i, "set_points", k)
            left_s = phase.duration_s - point.at_s
            _check(
                point.at_s,
                Range(0.0, phase.duration_s, f"s, the duration of {phase.name}"),
                *at,
                "at_s",
            )
            _check(point.over_s, Range(0.0, left_s, "s, the rest of the phase"), *at, "over_s")
            if point.at_s < free_s:
                raise problem(
                    f"= {point.at_s:g} is before the end of the previous set-point, {free_s:g} s",
                    *at,
                    "at_s",
                )
            free_s = point.at_s + point.over_s
            for name, (unit, step, rate) in LIMITS.items():
                value = getattr(point, name)
                if value is None:
                    continue
                change, allowed = abs(value - present[name]), max(step, rate * point.over_s)
                if change > allowed + 1e-9:
                    text = f"= {value:g} jumps by {change:g} {unit}, more than {allowed:g}"
                    raise problem(f"{text}; give over_s: {change / rate:g} or more", *at, name)
                present[name] = value
            yield begin_s + point.at_s, point
        begin_s += phase.duration_s


def _check(value: float, allowed: Range, *path: str | int) -> None:
    if complaint := allowed.complaint(value):
        raise problem(f"= {complaint}", *path)
