"""The report on a history of welds: what stands out, control charts, the tools' lives; one HTML file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from fsw_analysis.figure_style import sheet
from fsw_analysis.report import page, png, source
from fsw_quality.control_charts import CUSUM_LIMIT, SHEWHART_WIDTH, Chart, Trend, chart, trend
from fsw_quality.history import NUMBERS, column
from fsw_schema.files import write_whole

#: rise of the torque at equal conditions at which a tool counts as worn (chosen: 5 % of what the model says) [N m]
WORN_NM = 50.0
#: smallest spreads that count (chosen): three of them are harmless, however alike the welds are
_LEAST = {
    "temperature_error_mean_c": 0.1,
    "temperature_error_sigma_c": 0.1,
    "temperature_error_max_c": 0.3,
    "depth_error_mean_mm": 0.0005,
    "depth_error_sigma_mm": 0.0005,
    "depth_error_max_mm": 0.002,
    "torque_nm": 0.5,
    "power_kw": 0.02,
    "gain_heat": 0.005,
    "gain_depth": 0.005,
    "drift_torque_nm": 0.3,
    "drift_depth_um_per_min": 0.5,
    "drift_heat_c": 0.5,
}
#: what is charted: all but what differs by intention
CHARTED = tuple(name for name in NUMBERS if name != "duration_s")
#: welds in the report's tables, and with the same alarm from which on that is one line
_MOST, _ALIKE = 40, 3
_CHARTS = {"shewhart": "Shewhart", "ewma": "EWMA", "cusum": "CUSUM"}


@dataclass(frozen=True, slots=True)
class ToolLife:
    """A tool in the history."""

    tool: str
    welds: int
    trend: Trend | None

    @property
    def words(self) -> str:
        """Its life, with the interval."""
        if self.trend is None:
            return "too few welds to say"
        if not (self.trend.significant and self.trend.per_weld > 0.0):
            return "the torque does not rise: no end in sight"
        soonest, expected, latest = self.trend.life
        end = f"{latest:.0f}" if isfinite(latest) else "never"
        return f"worn ({WORN_NM:g} N·m more) after {expected:.0f} welds, 95 % interval {soonest:.0f} to {end}"


def charts(table: pa.Table) -> dict[str, Chart]:
    """The control charts that can be made."""
    made = {name: chart(column(table, name), least_sigma=_LEAST.get(name, 0.0)) for name in CHARTED}
    return {name: one for name, one in made.items() if one is not None}


def tools(table: pa.Table) -> list[ToolLife]:
    """The tools, in the order of their first welds."""
    names = np.array([one or "" for one in table["tool"].to_pylist()], object)
    torque = column(table, "torque_nm")
    return [
        ToolLife(tool or "not recorded", int(np.sum(names == tool)), trend(torque[names == tool], WORN_NM))
        for tool in dict.fromkeys(names.tolist())
    ]


def remarks(table: pa.Table, found: dict[str, Chart]) -> list[tuple[str, str]]:
    """Weld and what stands out there: first signals of the charts, alarms, swaps, operators' actions, verdicts."""
    names = table["weld"].to_pylist()
    said = [*_signals(found), *_alarms(names, table["alarm_texts"].to_pylist())]
    for i, weld in enumerate(table.select(["swaps", "operators", "verdict", "controllers"]).to_pylist()):
        if weld["swaps"]:
            said.append((i, f"{weld['swaps']} swap(s): {weld['controllers']}"))
        if weld["operators"]:
            said.append((i, f"operator acted: {weld['operators']}"))
        if weld["verdict"] in ("review", "reject"):
            said.append((i, f"verdict {weld['verdict']}"))
    return [(names[i], text) for i, text in sorted(said)]


def _signals(found: dict[str, Chart]) -> list[tuple[int, str]]:
    """Where the charts of each quantity signal first; those that do so at the same weld in one line."""
    said = []
    for name, one in found.items():
        first: dict[int, list[str]] = {}
        for kind, at in one.signals.items():
            if at:
                first.setdefault(at[0], []).append(kind)
        for at_first, kinds in first.items():
            later = max(len(one.signals[kind]) for kind in kinds) - 1
            more = f", and at {later} later weld{'s' * (later > 1)}" if later else ""
            value = f"{one.values[at_first]:.4g}, normally {one.centre:.4g} ± {one.sigma:.2g}"
            charts_of = ", ".join(_CHARTS[kind] for kind in kinds)
            said.append((at_first, f"{charts_of} chart of {NUMBERS[name]} signals: {value}{more}"))
    return said


def _alarms(names: Sequence[str], texts: Sequence[str | None]) -> list[tuple[int, str]]:
    """The alarms; one that many welds have, but for its figures, in one line at the first of them."""
    alike: dict[str, list[tuple[int, str]]] = {}
    for i, lines in enumerate(texts):
        for line in (lines or "").splitlines():
            alike.setdefault(re.sub(r"[-+]?[0-9][0-9.]*", "#", line), []).append((i, line))
    said = []
    for own in alike.values():
        welds = sorted({i for i, _ in own})
        if len(welds) > _ALIKE:
            more = f"alarm in {len(welds)} welds, the last is {names[welds[-1]]}; here at {own[0][1]}"
            said.append((welds[0], more))
        else:
            said += [(i, f"alarm at {line}") for i, line in own]
    return said


def write(table: pa.Table, target: Path, title: str) -> list[tuple[str, str]]:
    """Write the report as one HTML file; returns what stands out.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    found = charts(table)
    said = remarks(table, found)
    text = page(
        "fsw_quality",
        "history.html.j2",
        title=title,
        welds=table.num_rows,
        remarks=said[-_MOST:],
        left_out=max(0, len(said) - _MOST),
        tools=tools(table),
        image=source(draw(table, found)),
        table=[{**one, "words": _short(one)} for one in table.slice(max(0, table.num_rows - _MOST)).to_pylist()],
    )
    write_whole(target, text)
    return said


def _short(one: dict[str, Any]) -> str:
    return ", ".join(
        text
        for text in (
            one["alarm_kinds"] or "",
            f"{one['swaps']} swaps" if one["swaps"] else "",
            f"operator {one['operators']}" if one["operators"] else "",
        )
        if text
    )


def draw(table: pa.Table, found: dict[str, Chart]) -> bytes:
    """The control charts, as PNG: values with limits, CUSUM beside them, what signals in red."""
    shown = list(found)
    tool = table["tool"].to_pylist()
    changes = [i + 0.5 for i in range(1, len(tool)) if tool[i] != tool[i - 1]]
    with sheet(11.0, 1.6 * max(len(shown), 1) + 0.6) as figure:
        axes = figure.subplots(max(len(shown), 1), 2, sharex=True, squeeze=False, width_ratios=[2.2, 1.0])
        for (left, right), name in zip(axes, shown, strict=False):
            one = found[name]
            welds = np.arange(1, one.values.size + 1)
            left.plot(welds, one.values, ".", color="0.35", markersize=4 if welds.size < 500 else 1)
            left.plot(welds, one.ewma, color="#0b62a4", linewidth=1.2)
            for width in (-SHEWHART_WIDTH, 0.0, SHEWHART_WIDTH):
                left.axhline(
                    one.centre + width * one.sigma, color="0.5", linewidth=0.8, linestyle="--" if width else "-"
                )
            out = one.signals["shewhart"]
            left.plot(welds[out], one.values[out], "o", color="#d1495b", markersize=5, fillstyle="none")
            right.plot(welds, np.maximum(one.high, 0.0), color="#0b62a4", linewidth=1.0)
            right.plot(welds, -one.low, color="#0b62a4", linewidth=1.0)
            for limit in (CUSUM_LIMIT, -CUSUM_LIMIT):
                right.axhline(limit, color="#d1495b", linewidth=0.8, linestyle="--")
            left.set_title(NUMBERS[name], fontsize=8.5, loc="left")
            # one collection: a line for each of hundreds of tools takes seconds
            left.vlines(changes, 0.0, 1.0, transform=left.get_xaxis_transform(), color="#2e8540", linewidth=0.8)
        axes[0][1].set_title("CUSUM [σ]", fontsize=8.5, loc="left")
        for axis in axes[-1]:
            axis.set_xlabel("weld")
        return png(figure, 100)
