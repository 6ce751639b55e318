"""The report on a history of welds: what stands out, control charts, the tools' lives.

One HTML file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes

from fsw_analysis.figure_style import BLUE, GREEN, RED, legend_below, png, sheet
from fsw_analysis.report import page, source
from fsw_analysis.weld_signals import FloatArray
from fsw_control.schema.files import write_whole
from fsw_quality.control_charts import (
    FALSE_SIGNALS,
    WELDS,
    Chart,
    Trend,
    chart,
    correlation,
    limits,
    trend,
)
from fsw_quality.diagnosis import Finding, WatchCause
from fsw_quality.history import FINDINGS, NUMBERS, Change, Row, changes, column

#: rise of the torque at equal conditions at which a tool counts as worn (chosen: 5 % of what the
#: model says) [N m]
WORN_NM = 50.0
#: smallest spreads that count (chosen): some of them are harmless, however alike the welds are
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
#: what is charted: all but what differs by intention, as the duration does
CHARTED = tuple(_LEAST)
LIMITS = limits(len(CHARTED))
#: quantities that cannot be negative and have a long tail
SKEWED = tuple(
    name for name in CHARTED if "_sigma_" in name or "_max_" in name or name.startswith("drift_")
)
#: welds in the report's tables, welds with the same alarm from which on that is one line, and
#: changes in a line
_MOST, _ALIKE, _MOST_CHANGES = 40, 3, 3
_CHARTS = {"shewhart": "Shewhart", "cusum": "CUSUM"}
_BOUND: dict[str, Any] = {"color": RED, "linewidth": 0.9, "linestyle": "--"}
#: changes of these stand out from weld to weld, as do those of tuning and software
_SETTINGS = ("machine", "tool", "procedure", "procedure_sha256")


class Kind(StrEnum):
    """What stands out at a weld."""

    CHART = "chart"
    CORRELATION = "correlation"
    ALARM = "alarm"
    CHANGE = "change"
    SWAP = "swap"
    OPERATOR = "operator"
    VERDICT = "verdict"


@dataclass(frozen=True, slots=True)
class Remark:
    """Something that stands out."""

    at: int  #: number of the weld in the history, from 0
    kind: Kind
    #: the quantity that is charted, cause of the alarm, what changed, who operated, or the verdict
    subject: str = ""
    text: str = ""


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
        return (
            f"worn ({WORN_NM:g} N·m more) after {expected:.0f} welds, "
            f"95 % interval {soonest:.0f} to {end}"
        )


def charts(table: pa.Table) -> dict[str, Chart]:
    """The control charts that can be made.

    Of each procedure and tool by itself, among the accepted welds.
    """
    rows = table.select(["verdict", "alarms"]).to_pylist()
    accepted = [
        row["verdict"] == "accept" or not (row["verdict"] or row["alarms"]) for row in rows
    ]
    return charts_of({name: column(table, name) for name in CHARTED}, accepted, _groups(table))


def _groups(table: pa.Table) -> list[tuple[str, str]]:
    """Procedure and tool of each weld."""
    names = (table[name].to_pylist() for name in ("procedure_sha256", "tool"))
    return [(procedure or "", tool or "") for procedure, tool in zip(*names, strict=True)]


def charts_of(
    columns: Mapping[str, FloatArray],
    accepted: Sequence[bool] | None = None,
    groups: Sequence[object] | None = None,
) -> dict[str, Chart]:
    """The control charts of quantities by weld; see :func:`fsw_quality.control_charts.chart`."""
    made = {
        name: chart(values, LIMITS, _LEAST[name], name in SKEWED, accepted, groups)
        for name, values in columns.items()
    }
    return {name: entry for name, entry in made.items() if entry is not None}


def correlated(
    made: Mapping[str, Chart], groups: Sequence[object] | None = None
) -> dict[str, float]:
    """Quantities that are significantly correlated from weld to weld, and how much."""
    shares = {name: correlation(entry, len(CHARTED), groups) for name, entry in made.items()}
    return {name: share for name, (share, significant) in shares.items() if significant}


def performance() -> dict[str, float]:
    """Welds until the charts signal.

    All of them on stable welds, those of a quantity on a shift of 1, 2, 3 sigma.
    """
    lengths = {f"arl_{shift}_sigma": LIMITS.run_length(shift) for shift in (1, 2, 3)}
    return {"arl_stable": LIMITS.run_length() / len(CHARTED), **lengths}


def tools(table: pa.Table) -> list[ToolLife]:
    """The tools, in the order of their first welds."""
    names = np.array([tool or "" for tool in table["tool"].to_pylist()], object)
    torque = column(table, "torque_nm")
    return [
        ToolLife(
            tool or "not recorded",
            int(np.sum(names == tool)),
            trend(torque[names == tool], WORN_NM),
        )
        for tool in dict.fromkeys(names.tolist())
    ]


def remarks(table: pa.Table, made: dict[str, Chart]) -> list[Remark]:
    """What stands out.

    First signals of the charts, alarms, changed settings, swaps, operators' actions, verdicts.

    Correlated quantities, whose charts have no limits that hold, stand at the newest weld.
    """
    rows, groups = table.to_pylist(), _groups(table)
    notes = [*_signals(made, groups), *_alarms(rows)]
    for name, share in correlated(made, groups).items():
        text = (
            f"{NUMBERS[name]} is correlated from weld to weld ({share:+.2f}): the limits of its "
            "charts do not hold, their signals may be false"
        )
        notes.append(Remark(len(rows) - 1, Kind.CORRELATION, name, text))
    for i, (before, row) in enumerate(zip([None, *rows], rows, strict=False)):
        if before and (changed := changes(before, row, _SETTINGS)):
            notes.append(_changed(i, changed))
        if row["swaps"]:
            text = f"{row['swaps']} swap(s): {row['controllers']}"
            notes.append(Remark(i, Kind.SWAP, text=text))
        if row["operators"]:
            text = f"operator acted: {row['operators']}"
            notes.append(Remark(i, Kind.OPERATOR, row["operators"], text))
        if row["verdict"] in ("review", "reject"):
            notes.append(Remark(i, Kind.VERDICT, row["verdict"], f"verdict {row['verdict']}"))
    return sorted(notes, key=lambda entry: entry.at)


def _changed(at: int, changed: Sequence[Change]) -> Remark:
    shown = "; ".join(
        f"{what} {before} → {after}" for what, before, after in changed[:_MOST_CHANGES]
    )
    more = f"; and {len(changed) - _MOST_CHANGES} more" * (len(changed) > _MOST_CHANGES)
    return Remark(
        at, Kind.CHANGE, ", ".join(what for what, *_ in changed), f"changed: {shown}{more}"
    )


def _signals(made: dict[str, Chart], groups: Sequence[object]) -> Iterator[Remark]:
    """Where each chart signals first.

    The charts of a quantity that do so at the same weld in one line.
    """
    for name, entry in made.items():
        of_chart: dict[tuple[str, object], list[int]] = {}
        for kind, welds in entry.signals.items():
            for weld in welds:
                of_chart.setdefault((kind, groups[weld]), []).append(weld)
        first: dict[int, list[tuple[str, int]]] = {}
        for (kind, _), welds in of_chart.items():
            first.setdefault(welds[0], []).append((kind, len(welds) - 1))
        for at, kinds in first.items():
            later = max(count for _, count in kinds)
            more = f", and at {later} later weld{'s' * (later > 1)}" if later else ""
            value = (
                f"{entry.values[at]:.4g}, the welds before {entry.centre[at]:.4g} "
                f"({entry.scores[at]:+.1f} σ)"
            )
            words = ", ".join(_CHARTS[kind] for kind, _ in kinds)
            yield Remark(
                at, Kind.CHART, name, f"{words} chart of {NUMBERS[name]} signals: {value}{more}"
            )


def _alarms(rows: Sequence[Row]) -> Iterator[Remark]:
    """The alarms; one whose cause many welds have, in one line at the first of them."""
    by_cause: dict[str, list[tuple[int, str]]] = {}
    for i, row in enumerate(rows):
        for cause, text in _causes(row):
            by_cause.setdefault(cause, []).append((i, text))
    for cause, own in by_cause.items():
        welds = sorted({i for i, _ in own})
        if len(welds) > _ALIKE:
            last = rows[welds[-1]]["weld"]
            own = [(welds[0], f"{own[0][1]}; in {len(welds)} welds, the last is {last}")]
        for i, text in own:
            yield Remark(i, Kind.ALARM, cause, f"alarm{text}")


def _causes(row: Row) -> Iterator[tuple[str, str]]:
    """Cause of each alarm of a weld, and its words."""
    for alarm in row[FINDINGS] or ():
        cause, *others = map(WatchCause, (alarm["cause"], *alarm["others"]))
        text = Finding(cause, True, alarm["size"], alarm["error"], others=tuple(others)).text
        yield cause.word, f" at {alarm['begin_s']:.0f} s: {text}"


def write(table: pa.Table, target: Path, title: str, beside: Path | None = None) -> list[Remark]:
    """Write the report as one HTML file, and its charts also as ``beside``.

    Returns what stands out.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    made = charts(table)
    notes = remarks(table, made)
    text = page(
        "fsw_quality",
        "history.html.j2",
        title=title,
        welds=table.num_rows,
        names=table["weld"].to_pylist(),
        remarks=notes[-_MOST:],
        left_out=max(0, len(notes) - _MOST),
        tools=tools(table),
        image=source(draw(table, made, beside)),
        limits=LIMITS,
        false_signals=FALSE_SIGNALS,
        stable=WELDS,
        quantities=len(CHARTED),
        performance=performance(),
        table=[
            {**weld, "words": _short(weld)}
            for weld in table.slice(max(0, table.num_rows - _MOST)).to_pylist()
        ],
    )
    write_whole(target, text)
    return notes


def _short(weld: dict[str, Any]) -> str:
    return ", ".join(
        text
        for text in (
            weld["alarm_kinds"] or "",
            f"{weld['swaps']} swaps" if weld["swaps"] else "",
            f"operator {weld['operators']}" if weld["operators"] else "",
        )
        if text
    )


def draw(table: pa.Table, made: dict[str, Chart], beside: Path | None = None) -> bytes:
    """The control charts, two side by side, as PNG: values with limits, CUSUM beside them.

    ``beside``: also as this file.
    """
    groups = _groups(table)
    begins = [i + 0.5 for i in range(1, len(groups)) if groups[i] != groups[i - 1]]
    rows = max((len(made) + 1) // 2, 1)
    with sheet(13.0, 1.5 * rows + 1.0) as figure:
        axes = figure.subplots(
            rows, 4, sharex=True, squeeze=False, width_ratios=[2.2, 1.0, 2.2, 1.0]
        )
        pairs = axes.reshape(-1, 2)
        for (left, right), (name, entry) in zip(pairs, made.items(), strict=False):
            _draw_chart(left, entry, begins)
            left.set_title(NUMBERS[name], fontsize=8.5, loc="left")
            right.set_title("CUSUM [σ]", fontsize=8.5, loc="left")
            for one_sided in (entry.rise, -entry.fall):
                right.plot(
                    np.arange(1, entry.values.size + 1), one_sided, color=BLUE, linewidth=1.0
                )
            for limit in (LIMITS.cusum, -LIMITS.cusum):
                right.axhline(limit, **_BOUND)
        for axis in pairs[len(made) :].flat:
            axis.set_visible(False)
        for axis in pairs[max(len(made) - 2, 0) : len(made)].flat:
            axis.tick_params(labelbottom=True)
            axis.set_xlabel("weld")
        legend_below(figure, most=5)
        return png(figure, 100, beside)


def _draw_chart(axis: Axes, entry: Chart, begins: Sequence[float]) -> None:
    """Values with their mean and limits, what signals in red.

    ``begins``: first welds of groups.
    """
    welds = np.arange(1, entry.values.size + 1)
    small: dict[str, Any] = {"color": "0.35", "markersize": 4 if welds.size < 500 else 1}
    axis.plot(welds, entry.values, ".", **small, label="weld")
    axis.set_ylim(*axis.get_ylim())  # the limits of the first welds are far away
    axis.plot(welds, entry.centre, color="0.5", linewidth=1.0, label="mean of the welds before")
    for bound in (entry.low, entry.high):
        axis.plot(welds, bound, label="limit", **_BOUND)
    out = sorted({weld for signals in entry.signals.values() for weld in signals})
    ring: dict[str, Any] = {"color": RED, "markersize": 6, "fillstyle": "none"}
    axis.plot(welds[out], entry.values[out], "o", **ring, label="signals")
    if begins:
        # one collection: a line for each of hundreds of tools takes seconds
        across: dict[str, Any] = {"transform": axis.get_xaxis_transform(), "linewidth": 1.2}
        axis.vlines(begins, 0.0, 1.0, color=GREEN, label="new tool or procedure", **across)
