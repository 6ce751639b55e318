#!/usr/bin/env python3
"""The paper's five statements about its Figs.

6 to 9: whether each holds, and by which number, per controller.

usage: paper_statements.py [--quick] [--json FILE]

The cases are those of the comparison of controllers, without noise, on the model's own process.
"""

from collections.abc import Mapping
from typing import NamedTuple

import _benchmark
import numpy as np

from controller_comparison.study import CORRIDORS, paper_with
from fsw_analysis.weld_signals import WeldSignals
from fsw_control.weld import TICK_S
from fsw_tuning.standard_cases import (
    CASES,
    CONSERVATIVE,
    DEFAULT,
    DISTURBANCES,
    SET_POINTS,
    SMITH,
    TIGHT,
)
from fsw_tuning.standard_runs import Job, weld

#: time after an event that is judged: until the next one
AFTER_S = 40.0
#: smaller reversals of the speed do not count: the largest move of a tick
TURN_RPM = 3.0
#: what is still called damped and almost decoupled, as a share of the step of the output (chosen)
MOST_SHARE = 0.1
MOST_TURNS = 3  #: of the speed after an event that are still smooth (chosen)
#: time for half of a move that is still quick (chosen); the drives' limits alone take 1.4 s for
#: half of 84 rpm
QUICK_S = 1.5
LEAST_RPM = 10.0  #: rise of the speed that counts as one (chosen)
#: the paper's tuning with the other starts of its corridors, by their names on the page
VARIANTS = {f"nmpc:paper, {name}": name for name in ("constant", "recentred", "recentred_ahead")}
LABELS = (
    "nmpc:paper",
    "nmpc:paper:letter",
    *VARIANTS,
    DEFAULT,
    CONSERVATIVE,
    TIGHT,
    SMITH,
)


class Course(NamedTuple):
    """What followed an event.

    Errors of the outputs, and the inputs' changes since just before it.
    """

    depth_mm: np.ndarray
    temperature_c: np.ndarray
    force_kn: np.ndarray
    speed_rpm: np.ndarray


def after(signals: WeldSignals, at_s: float) -> Course:
    """The signals from an event on."""
    begin = round(at_s / TICK_S) - 1
    part = slice(begin, begin + round(AFTER_S / TICK_S))
    truth = signals.truth
    assert truth is not None  # a simulation has it
    return Course(
        (truth.depth_mm - signals.reference_depth_mm)[part],
        (truth.temperature_c - signals.reference_temperature_c)[part],
        signals.force_kn[part] - signals.force_kn[begin - 1],
        signals.speed_rpm[part] - signals.speed_rpm[begin - 1],
    )


def turns(values: np.ndarray, least: float) -> int:
    """How often a signal turns round, by at least so much."""
    count, way, low, high = 0, 0, float(values[0]), float(values[0])
    for value in values.tolist():
        low, high = min(low, value), max(high, value)
        for new, moved in ((1, value - low), (-1, high - value)):
            if way != new and moved >= least:
                count += way == -new
                way, low, high = new, value, value
                break
    return count


def half_s(values: np.ndarray) -> float:
    """Time until a signal has made half of its largest move upwards [s]."""
    return float(np.argmax(values >= 0.5 * values.max())) * TICK_S


def figures(courses: Mapping[str, Course]) -> dict[str, float]:
    """The numbers behind the statements, from what followed each event."""
    depth, temperature = courses["dz"], courses["dT"]
    steps_mm, steps_c = SET_POINTS["z up"].depth_mm, SET_POINTS["T up"].temperature_c
    coupled_mm = max(float(np.abs(courses[name].depth_mm).max()) for name in ("T up", "T down"))
    coupled_c = max(
        float(np.abs(courses[name].temperature_c).max()) for name in ("z up", "z down")
    )
    return {
        "iae_depth_mm_s": TICK_S * float(np.abs(depth.depth_mm).sum()),
        "iae_temperature_c_s": TICK_S * float(np.abs(temperature.temperature_c).sum()),
        "turns": max(turns(course.speed_rpm, TURN_RPM) for course in (depth, temperature)),
        "overshoot": max(
            -float(depth.depth_mm.min()) / DISTURBANCES["dz"].depth_mm,
            -float(temperature.temperature_c.max()) / DISTURBANCES["dT"].temperature_c,
            0.0,
        ),
        "coupled_mm": coupled_mm,
        "coupled_c": coupled_c,
        "coupled": max(coupled_mm / steps_mm, coupled_c / steps_c),
        "force_half_s": half_s(-depth.force_kn),
        "speed_half_s": half_s(depth.speed_rpm),
        "speed_rise_rpm": float(depth.speed_rpm.max()),
    }


def answers(own: Mapping[str, float], rival: Mapping[str, float]) -> dict[str, bool]:
    """Whether each statement holds of a controller.

    ``rival`` is the decentralized one's numbers.
    """
    is_quick = max(own["force_half_s"], own["speed_half_s"]) <= QUICK_S
    return {
        "faster": all(own[key] < rival[key] for key in ("iae_depth_mm_s", "iae_temperature_c_s")),
        "smooth": own["turns"] <= MOST_TURNS,
        "damped": own["overshoot"] <= MOST_SHARE,
        "decoupled": own["coupled"] <= MOST_SHARE,
        "quick": is_quick and own["speed_rise_rpm"] >= LEAST_RPM,
    }


def measured(label: str) -> dict[str, float]:
    """The numbers of a controller."""
    if label in VARIANTS:
        with paper_with(CORRIDORS[VARIANTS[label]]) as parameters:
            return run("nmpc", parameters)
    return run(label, {})


def run(label: str, parameters: dict[str, str]) -> dict[str, float]:
    """The numbers of a controller with parameters."""
    courses = {}
    for case, events in CASES.items():
        signals = weld(Job(label, case, parameters=parameters))
        courses |= {name: after(signals, step.at_s) for name, step in events.items()}
    return figures(courses)


def measure(quick: bool) -> tuple[_benchmark.Figures, Mapping[str, object]]:
    """Figures, and the content of the page."""
    labels = ("nmpc:paper", DEFAULT, CONSERVATIVE) if quick else LABELS
    numbers = dict(zip(labels, _benchmark.each(measured, labels, "controllers:"), strict=True))
    judged = {label: answers(own, numbers[CONSERVATIVE]) for label, own in numbers.items()}
    flat = _benchmark.flat({label: numbers[label] | judged[label] for label in labels})
    return flat, globals() | {"numbers": numbers, "judged": judged}


if __name__ == "__main__":
    _benchmark.run(
        __doc__,
        "the presets paper and default and one rival, no page",
        measure,
        "paper-statements",
    )
