"""A weld beside the last accepted welds of its procedure, from their records."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import scipy

from fsw_analysis.rules import Verdict
from fsw_control.schema.models import InputError, json_content_of, read_text, validate
from fsw_quality.record_content import Comparison, Figure, PhaseRecord, Record, other_version

#: welds that are compared with at most, the latest, and at least for a standard deviation to be
#: told (chosen)
MOST, LEAST = 10, 3
#: share of welds like the others that would be named by mistake, per figure: that of 3 standard
#: deviations (chosen)
_BY_MISTAKE = 0.0027
#: where records are looked for below a folder
_PLACES = ("record.json", "*/record.json", "*/record/record.json")


def accepted_before(folder: Path, record: Record, note: Callable[[str], object]) -> list[Record]:
    """Older accepted welds of the record's procedure and revision, from records in a folder.

    Records of another version of the format are left out; ``note`` is called for each.

    Raises
    ------
    InputError
        The folder has no record, one cannot be read, or two are of the same weld.
    """
    paths = sorted({path for place in _PLACES for path in folder.glob(place)})
    if not paths:
        raise InputError(f"{folder}: there is no record to compare with ({', '.join(_PLACES)})")
    seen: dict[tuple[str, ...], Path] = {}
    records = []
    for path in paths:
        content = json_content_of(read_text(path, "record"), str(path))
        if other := other_version(content, path):
            note(f"not compared: {other.line}")
            continue
        earlier = validate(Record, content, str(path))
        files = earlier.data_files
        if files == record.data_files:
            continue  # this weld
        if files and (first := seen.setdefault(files, path)) != path:
            raise InputError(
                f"{path}: is a second record of the weld of {first}; remove one of them"
            )
        same = (earlier.procedure.id, earlier.procedure.revision) == (
            record.procedure.id,
            record.procedure.revision,
        )
        if (
            same
            and earlier.verdict is Verdict.ACCEPT
            and (record.simulated_time or earlier.start_ns < record.start_ns)
        ):
            records.append(earlier)
    return sorted(records, key=lambda item: (item.start_ns, item.bag))[-MOST:]


def compare(record: Record, others: Sequence[Record]) -> Comparison:
    """The record's figures beside those of other welds, phase by phase."""
    figures = []
    for phase in record.phases:
        ours = dict(_figures(phase))
        theirs = [
            dict(_figures(row))
            for other in others
            for row in other.phases
            if row.phase == phase.phase
        ]
        for name, value in ours.items():
            values = np.array([row[name] for row in theirs if name in row])
            if not values.size:
                continue
            sigma = float(values.std(ddof=1)) if values.size >= LEAST else 0.0
            off = (value - float(values.mean())) / sigma if sigma > 1e-9 * abs(value) else None
            figures.append(
                Figure(
                    phase=phase.phase,
                    name=name,
                    value=value,
                    mean=values.mean(),
                    low=values.min(),
                    high=values.max(),
                    deviations=off,
                    is_far=off is not None and abs(off) > _limit(values.size),
                )
            )
    return Comparison(welds=tuple(weld.bag for weld in others), figures=tuple(figures))


def _limit(welds: int) -> float:
    """Half the prediction interval of one more normal value, in deviations of so many.

    G. J. Hahn, W. Q. Meeker: Statistical Intervals, 1991, chapter 4.
    """
    return float(
        scipy.stats.t.ppf(1.0 - 0.5 * _BY_MISTAKE, welds - 1) * np.sqrt(1.0 + 1.0 / welds)
    )


def _figures(phase: PhaseRecord) -> Iterator[tuple[str, float]]:
    for name, value in (
        ("depth error [mm]", phase.depth_mm),
        ("temperature error [°C]", phase.temperature_c),
    ):
        if value is not None:
            yield f"{name}, mean", value.mean
            yield f"{name}, σ", value.sigma
    for name, key in (
        ("torque [N·m]", "torque_nm"),
        ("force [kN]", "force_kn"),
        ("speed [rpm]", "speed_rpm"),
    ):
        if key in phase.envelopes:
            yield f"{name}, mean", phase.envelopes[key].mean
    if phase.heat_input_kj_per_mm is not None:
        yield "heat input [kJ/mm]", phase.heat_input_kj_per_mm
