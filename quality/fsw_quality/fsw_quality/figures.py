"""Figures of the record.

Traces with their limits, and the unrolled canister with its exceedances; for grey print.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from fsw_analysis.course import Course
from fsw_analysis.figure_style import png, sheet
from fsw_analysis.procedure import Procedure
from fsw_analysis.rule_book import Kind
from fsw_quality.record_content import Record

_PANELS = {
    "depth_mm": "depth [mm]",
    "temperature_c": "temperature [°C]",
    "force_kn": "force [kN]",
    "speed_rpm": "speed [rpm]",
    "torque_nm": "torque [N·m]",
    "power_kw": "power [kW]",
}
_DPI = 130
_LIMIT: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": (0, (6, 3))}
#: told apart without colour
_MARKS: dict[Kind, dict[str, Any]] = {
    "essential": {"facecolor": "black", "edgecolor": "black"},
    "quality": {"facecolor": "0.75", "edgecolor": "black", "hatch": "////"},
    "set_point": {"facecolor": "white", "edgecolor": "black", "hatch": "...."},
}
_MISSING: dict[str, Any] = {"facecolor": "white", "edgecolor": "black", "hatch": "xxxx"}
#: an exceedance is drawn at least this wide, as a share of the axis
_LEAST_WIDTH = 0.004
#: a limit is drawn when it is nearer to the data than this share of their span
_NEAR = 0.6


def traces(course: Course, procedure: Procedure, beside: Path | None = None) -> bytes:
    """Measured variables, set-points and limits over time, as PNG; also as the file ``beside``."""
    with sheet(9.0, 9.0) as figure:
        axes = figure.subplots(len(_PANELS), 1, sharex=True)
        minutes = course.time_s / 60.0
        for axis, (name, label) in zip(axes, _PANELS.items(), strict=True):
            axis.plot(minutes, course.values[name], color="0.35", linewidth=0.6)
            if (points := course.values.get(f"set_point_{name}")) is not None:
                axis.plot(minutes, points, color="black", linewidth=1.2)
            _limits(axis, name, course, procedure)
            axis.set_ylabel(label)
            for begin, length in course.gaps:
                axis.axvspan(begin / 60.0, (begin + length) / 60.0, **_MISSING)
            for _, ticks in course.spans()[1:]:
                axis.axvline(minutes[ticks][0], color="0.6", linewidth=0.8)
        for name, ticks in course.spans():
            if minutes[ticks][-1] - minutes[ticks][0] > 0.05 * minutes[-1]:
                axes[0].annotate(
                    name,
                    (minutes[ticks][0], 1.02),
                    xycoords=("data", "axes fraction"),
                    fontsize=8.0,
                )
        axes[-1].set_xlabel(
            "time [min]; black line: set-point in force; dashed: limit of the procedure"
        )
        figure.align_ylabels()
        return png(figure, _DPI, beside)


def _limits(axis: Axes, name: str, course: Course, procedure: Procedure) -> None:
    known = course.values[name][np.isfinite(course.values[name])]
    if not known.size:
        axis.annotate("not on record", (0.5, 0.5), xycoords="axes fraction", ha="center")
        return
    low, high = float(known.min()), float(known.max())
    room = _NEAR * max(high - low, 1e-9)
    for _, limit in procedure.limits():
        for value in (limit.min, limit.max):
            if limit.variable == name and value is not None and low - room <= value <= high + room:
                axis.axhline(value, **_LIMIT)


def unrolled(
    course: Course, procedure: Procedure, record: Record, beside: Path | None = None
) -> bytes | None:
    """The joint line unrolled, a row per limit, with exceedances and gaps in place, as PNG.

    None without angles. ``beside``: also as this file.
    """
    exceedances = record.exceedances
    known = course.angle_deg[np.isfinite(course.angle_deg)]
    if not known.size:
        return None
    outside = [exceedance.limit for exceedance in exceedances]
    rows = [check for check in procedure.checks() if check.kind != "set_point" or check in outside]
    end = max(float(known.max()), 1.0)
    with sheet(9.0, 1.4 + 0.3 * len(rows)) as figure:
        axis = figure.subplots()
        for row in exceedances:
            if row.angle_deg is None:
                continue
            begin, stop = row.angle_deg
            width = max(stop - begin, _LEAST_WIDTH * end)
            style = _MISSING if row.missing == row.samples else _MARKS[row.limit.kind]
            axis.barh(rows.index(row.limit), width, left=begin, height=0.7, linewidth=0.6, **style)
        for gap in record.gaps:
            if gap.angle_deg is not None:
                begin, stop = gap.angle_deg
                axis.axvspan(begin, max(stop, begin + _LEAST_WIDTH * end), **_MISSING)
        for name, ticks in course.spans():
            angles = course.angle_deg[ticks][np.isfinite(course.angle_deg[ticks])]
            if name and angles.size:
                axis.axvline(angles[0], color="0.6", linewidth=0.8)
                if angles[-1] - angles[0] > 0.01 * end:
                    axis.annotate(
                        name,
                        (angles[0], 1.01),
                        xycoords=("data", "axes fraction"),
                        fontsize=7.0,
                        rotation=90,
                    )
        axis.set_yticks(range(len(rows)), [check.words for check in rows], fontsize=8.0)
        axis.set_ylim(len(rows) - 0.4, -0.6)
        axis.set_xlim(0.0, end)
        axis.set_xticks(np.arange(0.0, end + 1.0, 30.0))
        arc_mm = 30.0 * procedure.geometry.diameter_mm * np.pi / 360.0
        axis.set_xlabel(
            f"angle about the canister [deg]; 30 deg are {arc_mm:.0f} mm of the joint line"
        )
        handles = [
            Patch(label=f"{kind.replace('_', '-')} limit left", **style)
            for kind, style in _MARKS.items()
        ]
        handles.append(Patch(label="samples missing", **_MISSING))
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.55 / (0.3 * len(rows)))}
        axis.legend(handles=handles, ncol=len(handles), frameon=False, fontsize=8.0, **below)
        return png(figure, _DPI, beside)
