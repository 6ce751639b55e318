"""Figures of merit as tables for people and as JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

#: Rows of the table: key, meaning, unit, factor to that unit.
ROWS: tuple[tuple[str, str, str, float], ...] = (
    ("iae_depth_mm_s", "IAE depth", "mm s", 1.0),
    ("iae_temperature_c_s", "IAE temperature", "degC s", 1.0),
    ("ise_depth_mm2_s", "ISE depth", "mm^2 s", 1.0),
    ("ise_temperature_c2_s", "ISE temperature", "degC^2 s", 1.0),
    ("overshoot_depth_mm", "largest overshoot depth", "um", 1e3),
    ("overshoot_temperature_c", "largest overshoot temperature", "degC", 1.0),
    ("longest_settling_s", "longest settling (5 % band)", "s", 1.0),
    ("steps_not_settled", "steps not settled in their window", "", 1.0),
    ("peak_temperature_in_depth_step_up_c", "peak temperature error, depth step up", "degC", 1.0),
    ("peak_temperature_in_depth_step_down_c", "peak temperature error, depth step down", "degC", 1.0),
    ("peak_depth_in_temperature_step_mm", "peak depth error, temperature step", "um", 1e3),
    ("peak_temperature_after_depth_disturbance_c", "peak temperature error, depth disturbance", "degC", 1.0),
    ("peak_depth_after_temperature_disturbance_mm", "peak depth error, temperature disturbance", "um", 1e3),
    ("in_dead_band_depth_share", "time within +-2 um", "%", 100.0),
    ("in_dead_band_temperature_share", "time within +-0.1 degC", "%", 100.0),
    ("total_variation_force_kn", "total variation force", "kN", 1.0),
    ("total_variation_speed_rpm", "total variation speed", "rpm", 1.0),
)


def _rows(runs: Sequence[dict[str, Any]]) -> list[tuple[str, str, str, float]]:
    keys = dict.fromkeys(key for run in runs for key in run if key.startswith("solve_time_"))
    solver = [(key, key.removesuffix("_ms").replace("_", " "), "ms", 1.0) for key in keys]
    return [row for row in [*ROWS, *solver] if any(run.get(row[0]) is not None for run in runs)]


def _number(value: float | None, factor: float) -> str:
    return "-" if value is None else f"{value * factor:.4g}"


def _cells(runs: Sequence[dict[str, Any]]) -> list[list[str]]:
    header = ["", "unit", *(str(run["label"]) for run in runs)]
    if len(runs) == 2:
        header.append("difference")
    table = [header]
    for key, meaning, unit, factor in _rows(runs):
        values = [run.get(key) for run in runs]
        row = [meaning, unit, *(_number(value, factor) for value in values)]
        if len(runs) == 2:
            row.append(_difference(values[0], values[1], factor))
        table.append(row)
    return table


def _difference(first: float | None, second: float | None, factor: float) -> str:
    if first is None or second is None:
        return "-"
    if first == 0.0:
        return f"{(second - first) * factor:+.4g}" if second else "0 %"
    return f"{100.0 * (second - first) / abs(first):+.1f} %"


def _padded(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = zip(row, widths, strict=True)
    return "  ".join(cell.ljust(width) if i < 2 else cell.rjust(width) for i, (cell, width) in enumerate(cells))


def text(runs: Sequence[dict[str, Any]]) -> str:
    """Table for the terminal: one row per figure of merit, one column per run (two runs: and their difference)."""
    table = _cells(runs)
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    lines = [_padded(row, widths) for row in table]
    return "\n".join([lines[0].rstrip(), "-" * len(lines[0]), *(line.rstrip() for line in lines[1:])]) + "\n"


def markdown(runs: Sequence[dict[str, Any]]) -> str:
    """The same table in markdown."""
    header, *rows = _cells(runs)
    marks = ["---", "---", *["---:"] * (len(header) - 2)]
    return "\n".join("| " + " | ".join(row) + " |" for row in [header, marks, *rows]) + "\n"


def write(runs: Sequence[dict[str, Any]], folder: Path) -> list[Path]:
    """Write ``kpi.json`` (the list of runs) and ``kpi.md`` into ``folder``; returns their paths."""
    json_path, table_path = folder / "kpi.json", folder / "kpi.md"
    json_path.write_text(json.dumps(list(runs), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    table_path.write_text(markdown(runs), encoding="utf-8")
    return [json_path, table_path]
