"""Figures of merit as tables in markdown and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from fsw_analysis.report import table
from fsw_control.schema.files import write_whole

#: Rows of the table: meaning, unit, factor to that unit, by key.
ROWS: dict[str, tuple[str, str, float]] = {
    "iae_depth_mm_s": ("IAE depth", "mm s", 1.0),
    "iae_temperature_c_s": ("IAE temperature", "degC s", 1.0),
    "ise_depth_mm2_s": ("ISE depth", "mm^2 s", 1.0),
    "ise_temperature_c2_s": ("ISE temperature", "degC^2 s", 1.0),
    "overshoot_depth_mm": ("largest overshoot depth", "um", 1e3),
    "overshoot_temperature_c": ("largest overshoot temperature", "degC", 1.0),
    "longest_settling_s": ("longest settling (5 % band)", "s", 1.0),
    "steps_not_settled": ("steps not settled in their window", "", 1.0),
    "peak_temperature_in_depth_step_up_c": ("peak temperature error, depth step up", "degC", 1.0),
    "peak_temperature_in_depth_step_down_c": (
        "peak temperature error, depth step down",
        "degC",
        1.0,
    ),
    "peak_depth_in_temperature_step_mm": ("peak depth error, temperature step", "um", 1e3),
    "peak_temperature_after_depth_disturbance_c": (
        "peak temperature error, depth disturbance",
        "degC",
        1.0,
    ),
    "peak_depth_after_temperature_disturbance_mm": (
        "peak depth error, temperature disturbance",
        "um",
        1e3,
    ),
    "in_dead_band_depth_share": ("time within +-2 um", "%", 100.0),
    "in_dead_band_temperature_share": ("time within +-0.1 degC", "%", 100.0),
    "total_variation_force_kn": ("total variation force", "kN", 1.0),
    "total_variation_speed_rpm": ("total variation speed", "rpm", 1.0),
}


def _cells(runs: Sequence[dict[str, Any]]) -> list[list[str]]:
    cells = [["", "unit", *(str(run["label"]) for run in runs)]]
    if len(runs) == 2:
        cells[0].append("difference")
    for key, (meaning, unit, factor) in ROWS.items():
        values = [run.get(key) for run in runs]
        if all(value is None for value in values):
            continue
        row = [
            meaning,
            unit,
            *("-" if value is None else f"{value * factor:.4g}" for value in values),
        ]
        if len(runs) == 2:
            row.append(_difference(values[0], values[1], factor, unit))
        cells.append(row)
    return cells


def _difference(first: float | None, second: float | None, factor: float, unit: str) -> str:
    """In percent of the first; of shares in points."""
    if first is None or second is None:
        return "-"
    if unit == "%":
        return f"{(second - first) * factor:+.4g} points"
    if first == 0.0:
        return f"{(second - first) * factor:+.4g}" if second else "0 %"
    return f"{100.0 * (second - first) / abs(first):+.1f} %"


def markdown(runs: Sequence[dict[str, Any]]) -> str:
    """Table with a row per figure of merit and a column per run.

    With two runs also their difference.

    Solve times are left out: they are the machine's, not the weld's (``kpi.json`` has them).
    """
    return table(_cells(runs), words=2, padded=True) + "\n"


class Kpi(dict[str, Any]):
    """Figures of merit by name; the same as attributes, with the unit in the name.

    None where a figure does not exist in this weld, e.g. an overshoot without a step. Controllers
    that solve a problem at each tick add ``solve_time_<controller>_p50_ms``, ``_p99_ms`` and
    ``_max_ms``. As text they are a table in Markdown.

    Attributes
    ----------
    outputs : str
        ``truth`` where the errors are those of the noise-free outputs, else ``measured``.
    events : list of dict
        Figures of each change of a set-point or a disturbance.

    Examples
    --------
    >>> import fsw
    >>> kpi = fsw.simulate("quick").kpi
    >>> kpi.iae_depth_mm_s == kpi["iae_depth_mm_s"]
    True
    >>> print(kpi)  # doctest: +ELLIPSIS
    |           ...| unit ...| decentral |
    ...
    """

    label: str
    controllers: list[str]
    outputs: str
    duration_s: float
    ticks: int
    ticks_without_output: int
    ticks_without_command: int
    iae_depth_mm_s: float | None
    iae_temperature_c_s: float | None
    ise_depth_mm2_s: float | None
    ise_temperature_c2_s: float | None
    in_dead_band_depth_share: float | None
    in_dead_band_temperature_share: float | None
    total_variation_force_kn: float | None
    total_variation_speed_rpm: float | None
    overshoot_depth_mm: float | None
    overshoot_temperature_c: float | None
    longest_settling_s: float | None
    steps_not_settled: float | None
    peak_temperature_in_depth_step_up_c: float | None
    peak_temperature_in_depth_step_down_c: float | None
    peak_depth_in_temperature_step_mm: float | None
    peak_temperature_after_depth_disturbance_c: float | None
    peak_depth_after_temperature_disturbance_mm: float | None
    events: list[dict[str, Any]]

    def __getattr__(self, name: str) -> Any:
        if name in self:
            return self[name]
        raise AttributeError(self._lacking(name))

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"figures of merit follow from the weld; {name} cannot be set")

    def __missing__(self, name: Any) -> Any:
        raise KeyError(self._lacking(name))

    def _lacking(self, name: Any) -> str:
        near = get_close_matches(str(name), self, 1)
        hint = f"did you mean {near[0]}?" if near else "all names: list(weld.kpi)"
        return f"no figure of merit {name}; {hint}"

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]

    def __repr__(self) -> str:
        return markdown([self]).rstrip()

    __str__ = _repr_markdown_ = __repr__


def write_both(data: list[dict[str, Any]], text: str, stem: Path) -> list[Path]:
    """Write data as ``<stem>.json`` and their table as ``<stem>.md``; returns the paths."""
    contents = {".json": json.dumps(data, indent=2, allow_nan=False) + "\n", ".md": text}
    for suffix, content in contents.items():
        write_whole(stem.with_suffix(suffix), content)
    return [stem.with_suffix(suffix) for suffix in contents]
