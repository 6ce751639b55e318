"""A recorded weld on a complete grid of ticks; values of missing ticks are unknown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite, nan
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Strict

from fsw_analysis.rule_book import Check, RuleBook
from fsw_analysis.weld_signals import FloatArray, TextArray, WeldSignals
from fsw_control.schema.models import Many, Model
from fsw_control.sensors import SENSORS
from fsw_control.units import KW_PER_NM_RPM
from fsw_control.validity import SensorGuard
from fsw_control.weld import TICK_S

#: most ticks to fill a gap, so that a damaged stamp does not exhaust the memory
_MOST_IN_A_GAP = 600
#: ticks after a change at which its report may come into force, and most ticks between two reports
#: of a tool that moves
_LATE, _BETWEEN_REPORTS = 2, 11
#: time over which the traverse speed is taken
_APART_S = 5.0
#: of a programme that has ended
OVER = ("done", "aborted")
#: by sensor, the signal that is its samples
SENSOR_SIGNALS = {name: row.signal for name, row in SENSORS.items()}


@dataclass(frozen=True, slots=True)
class Course:
    """The weld from its programme's first report to its end: arrays (n,), NaN if unknown.

    ``values`` has the variables of a procedure and the set-points in force, `set_point_depth_mm`
    and `set_point_temperature_c`; ``source`` is the commanding controller or mode, ``phase`` is
    empty without a report of the programme.
    """

    time_s: FloatArray
    angle_deg: FloatArray
    travel_mm: FloatArray
    phase: TextArray
    source: TextArray
    mode: TextArray
    held: npt.NDArray[np.bool_]  #: an operator had stopped the programme
    values: dict[str, FloatArray]
    put_in: npt.NDArray[np.bool_]  #: ticks that are missing on all topics
    gaps: list[tuple[float, float]]  #: begin and length [s] of each run of those
    end: str  #: how the programme ended: ``done``, ``aborted``, or empty: not on record

    @property
    def missing(self) -> dict[str, int]:
        """Unknown samples, by variable."""
        return {name: int(np.sum(~np.isfinite(values))) for name, values in self.values.items()}

    def place(
        self, begin_s: float, lasts_s: float, of: FloatArray | None = None
    ) -> tuple[float, float] | None:
        """Angle or another position before and after an interval; None if unknown.

        At the begin and the end of the weld it is known on one side only, which stands for both.
        """
        values = self.angle_deg if of is None else of
        known = np.isfinite(values)
        before = values[known & (self.time_s < begin_s - 1e-6)]
        after = values[known & (self.time_s > begin_s + lasts_s - 1e-6)]
        ends = [*before[-1:].tolist(), *after[:1].tolist()]
        return (ends[0], ends[-1]) if ends else None

    @property
    def controllers(self) -> tuple[str, ...]:
        """Active controllers, in order of time."""
        return tuple(dict.fromkeys(str(name) for name in self.source if name))

    def spans(self) -> list[tuple[str, slice]]:
        """Ticks of each phase, in order of time."""
        begins = [0, *(np.flatnonzero(self.phase[1:] != self.phase[:-1]) + 1).tolist()]
        ends = [*begins[1:], len(self.phase)]
        return [
            (str(self.phase[begin]), slice(begin, end))
            for begin, end in zip(begins, ends, strict=True)
        ]


def course_of(signals: WeldSignals) -> Course:
    """Course of a recorded weld from its sensors; the emulator's truth is not evidence."""
    over = [event for event in signals.events if event.kind == "weld" and event.subject in OVER]
    end_s = over[-1].time_s if over else float(signals.time_s[-1])
    begin_s = signals.phases[0][1] if signals.phases else _start_s(signals)
    inside = (signals.time_s >= begin_s - 1e-6) & (signals.time_s <= end_s + 1e-6)
    stops = [
        begin_s - TICK_S,
        *signals.time_s[inside].tolist(),
        *([end_s + TICK_S] if over else []),
    ]
    fillers, gaps = [signals.time_s[inside]], []
    for before, after in pairwise(stops):
        lacking = round((after - before) / TICK_S) - 1
        if lacking > 0:
            gaps.append((before + TICK_S, lacking * TICK_S))
            fillers.append(
                np.linspace(before + TICK_S, after - TICK_S, min(lacking, _MOST_IN_A_GAP))
            )
    time_s = np.concatenate(fillers)
    order = np.argsort(time_s, kind="stable")
    time_s, put_in = time_s[order], order >= np.count_nonzero(inside)
    ticks = np.resize(np.flatnonzero(inside), order.size)[order]  # any where one is put in

    def numbers(values: FloatArray) -> FloatArray:
        return np.where(put_in, np.nan, values[ticks])

    def texts(values: TextArray) -> TextArray:
        return np.where(put_in, "", values[ticks])

    drives, unknown = signals.drives, np.full(signals.n_ticks, np.nan)
    force, speed = (unknown, unknown) if drives is None else (drives.force_kn, drives.speed_rpm)
    travel_mm, traverse = _travel(signals, end_s)
    values = {
        "depth_mm": signals.depth_mm,
        "temperature_c": signals.temperature_c,
        "torque_nm": signals.torque_nm,
        **signals.optional,
        "force_kn": force,
        "speed_rpm": speed,
        "power_kw": signals.torque_nm * speed * KW_PER_NM_RPM,
        "traverse_mm_per_min": traverse,
        "depth_error_mm": signals.depth_mm - signals.programme_depth_mm,
        "temperature_error_c": signals.temperature_c - signals.programme_temperature_c,
        "set_point_depth_mm": signals.reference_depth_mm,
        "set_point_temperature_c": signals.reference_temperature_c,
    }
    return Course(
        time_s,
        numbers(signals.angle_deg),
        numbers(travel_mm),
        signals.phase_names(time_s),
        texts(signals.command_source),
        texts(signals.actual_mode),
        _held(signals, time_s),
        {name: numbers(value) for name, value in values.items()},
        put_in,
        gaps,
        over[-1].subject if over else "",
    )


def _start_s(signals: WeldSignals) -> float:
    """Begin of a weld without a programme: the first tick in automatic control."""
    auto = np.flatnonzero(signals.actual_mode == "auto")
    return float(signals.time_s[auto[0] if auto.size else 0])


def _held(signals: WeldSignals, time_s: FloatArray) -> npt.NDArray[np.bool_]:
    held, since_s = np.zeros(time_s.size, bool), None
    for event in (candidate for candidate in signals.events if candidate.kind == "weld"):
        if since_s is not None:
            held |= (time_s > since_s + 1e-6) & (time_s <= event.time_s + 1e-6)
        since_s = event.time_s if event.subject == "held" else None
    return held if since_s is None else held | (time_s > since_s + 1e-6)


class UnusableRun(NamedTuple):
    """Consecutive samples of a sensor that are not used, for one reason."""

    sensor: str
    flaw: str
    begin_s: float
    end_s: float  #: of the last of them


class UnusableSamples:
    """Samples that the supervisor would hold or reject with its defaults."""

    def __init__(self) -> None:
        self._guard = SensorGuard()
        self.counts = {name: Counter[str]() for name in SENSORS}  #: by sensor and reason
        self.runs: list[UnusableRun] = []
        self._open: dict[str, int] = {}  # place of the last run of a sensor that is not over

    def add(self, time_s: float, values: Mapping[str, float]) -> None:
        """Take a tick: values by signal, NaN if missing."""
        samples = {name: values.get(signal, nan) for name, signal in SENSOR_SIGNALS.items()}
        self._guard.measure(
            time_s, {name: value for name, value in samples.items() if isfinite(value)}
        )
        for name, reason in self._guard.reasons.items():
            row = self._open.pop(name, None)
            if not reason:
                continue
            self.counts[name][reason] += 1
            if row is None or self.runs[row].flaw != reason:
                row = len(self.runs)
                self.runs.append(UnusableRun(name, str(reason), time_s, time_s))
            self.runs[row] = self.runs[row]._replace(end_s=time_s)
            self._open[name] = row


def unusable_samples(course: Course) -> UnusableSamples:
    """Samples of a weld that would be held or rejected."""
    unusable = UnusableSamples()
    columns = {
        name: course.values[name].tolist()
        for name in SENSOR_SIGNALS.values()
        if name in course.values
    }
    for time_s, *values in zip(course.time_s.tolist(), *columns.values(), strict=True):
        unusable.add(time_s, dict(zip(columns, values, strict=True)))
    return unusable


def _travel(signals: WeldSignals, end_s: float) -> tuple[FloatArray, FloatArray]:
    """Position along the weld [mm] and traverse speed [mm/min] by the programme's reports.

    They come each second and when something begins or ends. The stamp of a report is up to a tick
    off the position that it tells, 10 % of a second's travel, so the speed is taken over some
    seconds between two of them.
    """
    known = np.flatnonzero(
        np.isfinite(signals.travel_mm) & (signals.time_s <= end_s + _LATE * TICK_S + 1e-6)
    )
    if not known.size:
        return signals.travel_mm, signals.travel_mm
    changed_s = [begin_s for _, begin_s in signals.phases] + [
        event.time_s for event in signals.events if event.kind == "weld"
    ]
    changed_s.append(end_s)
    turns = np.clip(
        np.searchsorted(signals.time_s, np.array(changed_s) - 1e-6), known[0], known[-1]
    )
    moved = known[np.diff(signals.travel_mm[known], prepend=np.nan) != 0.0]
    # the report of a change may come into force after it; of a tool that moves, what is in force
    # then is out of date
    latest = moved[np.searchsorted(moved, turns + _LATE, side="right") - 1]
    before = (
        np.searchsorted(moved, turns, side="right") - 1
    )  # 0: the first report, of a tool that has not moved yet
    moving = (before > 0) & (turns - moved[before] <= _BETWEEN_REPORTS)
    turns = np.where(moving, np.maximum(turns, latest), turns)
    reports = np.unique([*moved[moved <= turns[-1]], *turns])
    rows = _apart(signals.time_s[reports], np.isin(reports, turns))
    at_s, at_mm = signals.time_s[reports][rows], signals.travel_mm[reports][rows]
    speed = np.append(np.diff(at_mm) / np.diff(at_s), 0.0)  # mm/s
    speed[-1] = speed[-2:][0]  # the last sample belongs to what was before it
    row = np.searchsorted(at_s, signals.time_s, side="right") - 1
    inside = np.isfinite(signals.travel_mm)
    position_mm = at_mm[row] + speed[row] * (signals.time_s - at_s[row])
    return np.where(inside, position_mm, np.nan), np.where(inside, 60.0 * speed[row], np.nan)


def _apart(reports_s: FloatArray, fixed: npt.NDArray[np.bool_]) -> list[int]:
    """Reports to use: first, last, fixed ones, and others at a distance between them."""
    rows, last = [0], reports_s.size - 1
    for row in range(1, last + 1):
        if fixed[row] or row == last:
            if (
                len(rows) > 1
                and not fixed[rows[-1]]
                and reports_s[row] - reports_s[rows[-1]] < 0.5 * _APART_S
            ):
                rows.pop()
            rows.append(row)
        elif reports_s[row] - reports_s[rows[-1]] >= _APART_S:
            rows.append(row)
    return rows


#: to six decimals
Rounded = Annotated[float, AfterValidator(lambda value: round(float(value), 6))]
Pair = Annotated[tuple[Rounded, Rounded], Strict(False)]


class Exceedance(Model):
    """Consecutive samples outside a limit or missing."""

    limit: Check
    begin_s: Rounded
    """on the clock of the weld, whose first tick is at 0.1 s"""
    duration_s: Rounded
    samples: int
    missing: int
    """of the samples, those that are not on record"""
    extreme: Rounded | None = None
    """value that is furthest outside; without one when no sample is on record"""
    beyond: Rounded | None = None
    """how far it is outside"""
    phases: Many[str]
    angle_deg: Pair | None = None
    """from and to, if the programme reports it"""
    travel_mm: Pair | None = None
    """from and to along the weld, if reported"""
    commanded_by: str
    """sources of the applied commands; empty when not on record"""


def beyond(values: FloatArray, low: float | None, high: float | None) -> FloatArray:
    """Distance of values outside their range; 0 inside, NaN for a missing sample."""
    below = 0.0 if low is None else np.maximum(low - values, 0.0)
    above = 0.0 if high is None else np.maximum(values - high, 0.0)
    excess: FloatArray = np.where(np.isfinite(values), below + above, np.nan)
    return excess


def runs(outside: npt.NDArray[np.bool_]) -> list[slice]:
    """Stretches of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], outside, [False]]).astype(np.int8)))
    return [slice(begin, end) for begin, end in edges.reshape(-1, 2).tolist()]


def exceedances(course: Course, book: RuleBook) -> list[Exceedance]:
    """All exceedances of limits and permitted set-points, in the order of the checks.

    A missing sample counts as outside. Ticks missing on all topics are gaps of the recording,
    which are reported once and not for every limit.
    """
    return [exceedance for check in book.checks() for exceedance in _exceedances(course, check)]


def holds(course: Course, check: Check) -> npt.NDArray[np.bool_]:
    """Ticks at which a check applies: in its phases, and if the phase is unknown."""
    if not check.phases:
        return np.ones(course.time_s.size, bool)
    return np.isin(course.phase.astype(str), [*check.phases, ""])


def longest_s(course: Course, check: Check) -> float:
    """Longest time outside a limit, including adjacent gaps of the recording."""
    stretches = runs(_outside(course, check))
    times = [_duration_s(course, run) for run in stretches if not course.put_in[run].all()]
    return max(times, default=0.0)


def length_mm(course: Course, check: Check) -> float:
    """Length of the weld outside a limit, all places together: n samples are n ticks of travel."""
    steps = np.diff(course.travel_mm, prepend=course.travel_mm[:1])
    return float(np.nansum(np.abs(steps[_outside(course, check) & ~course.put_in])))


def _outside(course: Course, check: Check) -> npt.NDArray[np.bool_]:
    """Ticks at which a check applies and its limits are not kept."""
    excess = beyond(course.values[check.variable], check.min, check.max)
    return ~(excess == 0.0) & holds(course, check)


def _duration_s(course: Course, run: slice) -> float:
    """In whole ticks: the stamps of a real clock jitter, which lengthens no exceedance."""
    lasts_s = course.time_s[run.stop - 1] - course.time_s[run.start]
    return TICK_S * (round(float(lasts_s) / TICK_S) + 1)


def _exceedances(course: Course, check: Check) -> list[Exceedance]:
    values = course.values[check.variable]
    excess = beyond(values, check.min, check.max)
    exceeded = []
    for run in runs(_outside(course, check) & ~course.put_in):
        missing = ~np.isfinite(excess[run])
        worst = None if missing.all() else int(np.nanargmax(excess[run]))
        exceeded.append(
            Exceedance(
                limit=check,
                begin_s=course.time_s[run.start],
                duration_s=_duration_s(course, run),
                samples=run.stop - run.start,
                missing=int(missing.sum()),
                extreme=None if worst is None else values[run][worst],
                beyond=None if worst is None else excess[run][worst],
                phases=tuple(dict.fromkeys(str(name) for name in course.phase[run] if name)),
                angle_deg=_ends(course.angle_deg[run]),
                travel_mm=_ends(course.travel_mm[run]),
                commanded_by=", ".join(
                    dict.fromkeys(str(name) for name in course.source[run] if name)
                ),
            )
        )
    return exceeded


def _ends(values: FloatArray) -> tuple[float, float] | None:
    known = values[np.isfinite(values)]
    return (known[0], known[-1]) if known.size else None
