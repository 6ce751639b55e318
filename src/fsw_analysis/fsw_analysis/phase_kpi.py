"""Figures of merit of each phase of a whole weld, next to published ones of real welds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from itertools import chain

import numpy as np

from fsw_analysis.kpi import true_or_measured
from fsw_analysis.report import table
from fsw_analysis.weld_signals import FloatArray, WeldSignals

#: name, begin and end [s] of a phase
Span = tuple[str, float, float]


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Mean, standard deviation, smallest and largest of an error, actual minus set-point value."""

    mean: float
    sigma: float
    low: float
    high: float

    @classmethod
    def of(cls, error: FloatArray) -> ErrorStatistics | None:
        """Of the values that are known; None without any."""
        known = error[np.isfinite(error)]
        return (
            cls(*map(float, (known.mean(), known.std(), known.min(), known.max())))
            if known.size
            else None
        )


#: Temperature of real welds by generation of control: cycles and error [degC] (SKB, site-visit
#: slides, 2011).
PUBLISHED = {
    "manual axial force": (2, ErrorStatistics(9.0, 11.0, -25.0, 47.0)),
    "demonstration series": (20, ErrorStatistics(4.0, 6.0, -52.0, 49.0)),
    "first controller": (1, ErrorStatistics(3.0, 4.0, -23.0, 19.0)),
    "cascade": (8, ErrorStatistics(0.6, 1.0, -7.0, 8.0)),
}


@dataclass(frozen=True, slots=True)
class PhaseFigures:
    """Errors and mean power of a run in a phase; None where they are not known.

    Errors are those relative to the programme, and also those relative to the set-points in force:
    a weld that was held and controlled by hand may follow other set-points well.
    """

    run: str
    phase: str
    power_kw: float | None
    temperature_c: ErrorStatistics | None
    depth_mm: ErrorStatistics | None
    in_force_temperature_c: ErrorStatistics | None
    in_force_depth_mm: ErrorStatistics | None


def compute(signals: WeldSignals, label: str, spans: Sequence[Span]) -> list[PhaseFigures]:
    """Figures of each phase and of the whole weld; errors as in :func:`fsw_analysis.kpi.compute`.

    ``spans`` are on the scenario's clock; those of the programme are right as long as the weld was
    not held, those of :func:`recorded_spans` always.
    """
    outputs, time_s, truth = true_or_measured(signals), signals.time_s, signals.truth
    power_kw = np.full(len(time_s), np.nan) if truth is None else truth.process_power_kw
    figures = []
    for phase, begin_s, end_s in [*spans, ("whole weld", 0.0, np.inf)]:
        inside = (time_s > begin_s + 1e-6) & (time_s <= end_s + 1e-6)
        power, *errors = (
            ErrorStatistics.of(values[inside])
            for values in (
                power_kw,
                outputs.temperature_c - signals.programme_temperature_c,
                outputs.depth_mm - signals.programme_depth_mm,
                outputs.temperature_c - signals.reference_temperature_c,
                outputs.depth_mm - signals.reference_depth_mm,
            )
        )
        mean_kw = None if power is None else power.mean
        figures.append(PhaseFigures(label, phase, mean_kw, *errors))
    return figures


def recorded_spans(signals: WeldSignals) -> list[Span]:
    """Name, begin and end [s] of the executed phases with holds; empty without a programme."""
    if not signals.phases:
        return []
    begins = [0.0, *(begin_s for _, begin_s in signals.phases[1:])]
    ends = [*begins[1:], float(signals.time_s[-1])]
    return [
        (name, begin, end)
        for (name, _), begin, end in zip(signals.phases, begins, ends, strict=True)
    ]


def markdown(runs: Sequence[Sequence[PhaseFigures]]) -> str:
    """Table of all phases and the published figures; welds in the same phases are side by side."""
    cells = [("phase", "run", "temperature error [°C]", "depth error [µm]", "mean power [kW]")]
    alike = len({tuple(row.phase for row in run) for run in runs}) == 1
    for row in chain(*(zip(*runs, strict=True) if alike else runs)):
        power = "-" if row.power_kw is None else f"{row.power_kw:.1f}"
        errors = _words(row.temperature_c, 1.0, 2), _words(row.depth_mm, 1e3, 1)
        cells.append((row.phase, row.run, *errors, power))
        in_force = (row.in_force_temperature_c, row.in_force_depth_mm)
        if in_force != (row.temperature_c, row.depth_mm):
            errors = _words(in_force[0], 1.0, 2), _words(in_force[1], 1e3, 1)
            cells.append(("", "against the set-points in force", *errors, ""))
    for name, (cycles, error) in PUBLISHED.items():
        welds = f"published, {cycles} real weld{'s'[: cycles > 1]}"
        cells.append((welds, name, _words(error, 1.0, 1), "-", "-"))
    lines = table(cells, words=4, padded=True)
    return f"Errors against the programme: mean, σ, min, max.\n\n{lines}\n"


def _words(error: ErrorStatistics | None, factor: float, digits: int) -> str:
    if error is None:
        return "-"
    mean, sigma, low, high = (factor * value for value in astuple(error))
    return f"{mean:+.{digits}f}, {sigma:.{digits}f}, {low:+.{digits}f}, {high:+.{digits}f}"
