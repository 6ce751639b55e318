"""Figure of a watched weld: disturbances, likelihood of the likeliest fault, alarms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.figure_style import BLUE, RED, sheet
from fsw_quality.monitor import ALARM, TREND
from fsw_quality.monitor_run import Watched

_LABELS = "torque\n[N·m]", "force\n[kN]", "heat\n[°C]"
_GREY = "#777777"
_TREND: dict[str, Any] = {"facecolor": "white", "edgecolor": RED, "hatch": "////"}


def draw(watched: Watched, title: str, file: Path) -> None:
    """Write the figure: PNG, SVG or PDF."""
    intervals = watched.alarms + [one for one in watched.others if one.finding.cause.of_process]
    causes = list(dict.fromkeys(one.finding.cause for one in intervals))
    minutes = np.array(watched.time_s) / 60.0
    with sheet(9.0, 7.5 + 0.25 * len(causes), file) as figure:
        figure.suptitle(title)
        axes = figure.subplots(
            5, 1, sharex=True, height_ratios=[1.0, 1.0, 1.0, 1.3, max(0.3 * len(causes), 0.5)]
        )
        for axis, label, values in zip(
            axes, _LABELS, zip(*watched.disturbances, strict=True), strict=False
        ):
            axis.plot(minutes, values, color=BLUE)
            axis.set_ylabel(label)
        axes[0].set_title(
            "what neither the model nor its coefficients explain", fontsize=9.0, loc="left"
        )
        axes[3].plot(minutes, watched.ratios, color=BLUE, label="to a harmless fault, for alarms")
        axes[3].plot(
            minutes, watched.trends, color=_GREY, linewidth=1.0, label="to none, for trends"
        )
        axes[3].legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8.0, frameon=False
        )
        for level, word, color in ((TREND, "trend", _GREY), (ALARM, "alarm", BLUE)):
            axes[3].axhline(level, color=color, linestyle="--", linewidth=1.0)
            axes[3].annotate(
                word, (1.0, level), xycoords=("axes fraction", "data"), ha="right", va="bottom"
            )
        axes[3].set_ylabel("log likelihood\nratio")
        axes[3].set_ylim(0.0, max(1.5 * ALARM, min(max(watched.ratios), 5.0 * ALARM)))
        for one in intervals:
            look = {"color": RED} if one.finding.alarm else _TREND
            width = (one.end_s - one.begin_s) / 60.0
            axes[4].barh(causes.index(one.finding.cause), width, left=one.begin_s / 60.0, **look)
        axes[4].set_yticks(
            range(len(causes)), [one.word.replace("_", " ") for one in causes], fontsize=8.0
        )
        axes[4].set_ylim(max(len(causes), 1) - 0.5, -0.5)
        axes[4].set_title(
            "alarms; hatched: trends" if causes else "no alarm", fontsize=9.0, loc="left"
        )
        axes[4].set_xlabel("time [min]")
        figure.align_ylabels(axes[:4])
