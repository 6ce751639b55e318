"""Exceedances of the limits of a weld. A missing sample counts as outside.

Ticks missing on all topics are gaps of the recording, reported once and not for every limit.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Strict

from fsw_analysis.course import Course
from fsw_analysis.rule_book import Check, RuleBook
from fsw_analysis.weld_signals import FloatArray
from fsw_control.schema.models import Many, Model
from fsw_control.weld import TICK_S

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
    """All exceedances of limits and permitted set-points, in the order of the checks."""
    return [exceedance for check in book.checks() for exceedance in _exceedances(course, check)]


def holds(course: Course, check: Check) -> npt.NDArray[np.bool_]:
    """Ticks at which a check applies: in its phases, and if the phase is unknown."""
    if not check.phases:
        return np.ones(course.time_s.size, bool)
    return np.isin(course.phase.astype(str), [*check.phases, ""])


def longest_s(course: Course, check: Check) -> float:
    """Longest time outside a limit, including adjacent gaps of the recording."""
    outside = ~(beyond(course.values[check.variable], check.min, check.max) == 0.0) & holds(
        course, check
    )
    times = [_duration_s(course, run) for run in runs(outside) if not course.put_in[run].all()]
    return max(times, default=0.0)


def length_mm(course: Course, check: Check) -> float:
    """Length of the weld outside a limit, all places together: n samples are n ticks of travel."""
    outside = ~(beyond(course.values[check.variable], check.min, check.max) == 0.0)
    steps = np.diff(course.travel_mm, prepend=course.travel_mm[:1])
    return float(np.nansum(np.abs(steps[outside & holds(course, check) & ~course.put_in])))


def _duration_s(course: Course, run: slice) -> float:
    """In whole ticks: the stamps of a real clock jitter, which lengthens no exceedance."""
    lasts_s = course.time_s[run.stop - 1] - course.time_s[run.start]
    return TICK_S * (round(float(lasts_s) / TICK_S) + 1)


def _exceedances(course: Course, check: Check) -> list[Exceedance]:
    values = course.values[check.variable]
    excess = beyond(values, check.min, check.max)
    exceeded = []
    for run in runs(~(excess == 0.0) & holds(course, check) & ~course.put_in):
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
