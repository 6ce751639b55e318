"""A recorded weld on its ticks, with those that are missing put in: what is not recorded is not known."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fsw_analysis.weld_signals import FloatArray, TextArray, WeldSignals
from fsw_control.units import kw_from_w, rad_s_from_rpm
from fsw_control.weld import TICK_S

#: ticks that are put into one gap, so that a damaged stamp does not fill the memory
_MOST_IN_A_GAP = 600
#: reports of the tool's position that are further apart mean that it stood; they come each second
_STANDS_S = 2.5
_OVER = ("weld done", "weld aborted")


@dataclass(frozen=True, slots=True)
class Course:
    """The weld from its first tick to its end; every array has shape (n,), unknown numbers are NaN.

    ``values`` has the variables of a procedure and the set-points in force, `set_point_depth_mm` and
    `set_point_temperature_c`; ``source`` is who commanded, ``phase`` is empty where no programme says it.
    """

    time_s: FloatArray
    angle_deg: FloatArray
    travel_mm: FloatArray
    phase: TextArray
    source: TextArray
    mode: TextArray
    values: dict[str, FloatArray]
    gaps: list[tuple[float, float]]  #: begin and length [s] of what is missing on all topics
    end: str  #: how the programme ended: ``done``, ``aborted``, or empty: not on record

    @property
    def missing(self) -> dict[str, int]:
        """Samples that are not known, by variable."""
        return {name: int(np.sum(~np.isfinite(values))) for name, values in self.values.items()}

    def spans(self) -> list[tuple[str, slice]]:
        """Ticks of each phase, in order of time."""
        begins = [0, *(np.flatnonzero(self.phase[1:] != self.phase[:-1]) + 1).tolist()]
        ends = [*begins[1:], len(self.phase)]
        return [(str(self.phase[begin]), slice(begin, end)) for begin, end in zip(begins, ends, strict=True)]


def course_of(signals: WeldSignals) -> Course:
    """The course of a recorded weld, from its sensors alone: the emulator's truth is no evidence."""
    over = [event for event in signals.events if event.kind == "weld" and event.text in _OVER]
    end_s = over[-1].time_s if over else float(signals.time_s[-1])
    inside = signals.time_s <= end_s + 1e-6
    stops = [*signals.time_s[inside].tolist(), *([end_s + TICK_S] if over else [])]
    known_s, fillers, gaps = signals.time_s[inside], [np.empty(0)], []
    for before, after in pairwise(stops):
        lacking = round((after - before) / TICK_S) - 1
        if lacking > 0:
            gaps.append((before + TICK_S, lacking * TICK_S))
            fillers.append(np.linspace(before + TICK_S, after - TICK_S, min(lacking, _MOST_IN_A_GAP)))
    put_in = np.concatenate(fillers)
    order = np.argsort(np.concatenate([known_s, put_in]), kind="stable")

    def numbers(values: FloatArray) -> FloatArray:
        return np.concatenate([values[inside], np.full(put_in.size, np.nan)])[order]

    def texts(values: TextArray) -> TextArray:
        return np.concatenate([values[inside], np.full(put_in.size, "", object)])[order]

    time_s = np.concatenate([known_s, put_in])[order]
    drives, unknown = signals.drives, np.full(signals.n_ticks, np.nan)
    force, speed = (unknown, unknown) if drives is None else (drives.force_kn, drives.speed_rpm)
    travel_mm, traverse = _travel(signals)
    values = {
        "depth_mm": signals.depth_mm,
        "temperature_c": signals.temperature_c,
        "torque_nm": signals.torque_nm,
        "force_kn": force,
        "speed_rpm": speed,
        "power_kw": np.array(kw_from_w(signals.torque_nm * rad_s_from_rpm(speed))),
        "traverse_mm_per_min": traverse,
        "depth_error_mm": signals.depth_mm - signals.programme_depth_mm,
        "temperature_error_c": signals.temperature_c - signals.programme_temperature_c,
        "set_point_depth_mm": signals.reference_depth_mm,
        "set_point_temperature_c": signals.reference_temperature_c,
    }
    names = np.array([name for name, _ in signals.phases] or [""], object)
    begins = [begin - 1e-6 for _, begin in signals.phases[1:]]
    return Course(
        time_s,
        numbers(signals.angle_deg),
        numbers(travel_mm),
        names[np.searchsorted(begins, time_s, side="right")],
        texts(signals.command_source),
        texts(signals.actual_mode),
        {name: numbers(one) for name, one in values.items()},
        gaps,
        over[-1].text.removeprefix("weld ") if over else "",
    )


def _travel(signals: WeldSignals) -> tuple[FloatArray, FloatArray]:
    """Position along the weld [mm] and traverse speed [mm/min] at the ticks, from reports that come each second."""
    known = np.flatnonzero(np.isfinite(signals.travel_mm))
    if not known.size:
        return signals.travel_mm, signals.travel_mm
    new = known[np.flatnonzero(np.diff(signals.travel_mm[known], prepend=np.nan) != 0.0)]
    at_s, at_mm = signals.time_s[new], signals.travel_mm[new]
    if new.size < 2:
        return signals.travel_mm, np.where(np.isfinite(signals.travel_mm), 0.0, np.nan)
    steps_s = np.diff(at_s)
    speed = np.append(np.where(steps_s > _STANDS_S, 0.0, 60.0 * np.diff(at_mm) / steps_s), 0.0)
    row = np.searchsorted(at_s, signals.time_s, side="right") - 1
    inside = np.isfinite(signals.travel_mm)
    at = at_mm[row] + speed[row] / 60.0 * (signals.time_s - at_s[row])
    return np.where(inside, at, np.nan), np.where(inside, speed[row], np.nan)
