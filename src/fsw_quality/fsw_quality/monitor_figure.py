"""Figure of a watched weld: the residuals against their limits, the other figures as shares of theirs, the alarms."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fsw_analysis.figure_style import sheet
from fsw_quality.diagnosis import RESIDUALS, Limits
from fsw_quality.monitor_run import Watched

_UNITS = {"torque": "N·m", "depth": "µm/min", "heat": "°C"}
#: other figures that are drawn: those nearest to their limits
_MOST = 5


def draw(watched: Watched, limits: Limits, title: str, file: Path) -> None:
    """Write the figure as PNG."""
    kinds = list(dict.fromkeys(one.finding.kind for one in watched.alarms))
    heights = [1.0, 1.0, 1.0, 1.3, max(0.3 * len(kinds), 0.5)]
    minutes = np.array(watched.time_s) / 60.0
    with sheet(9.0, 7.5 + 0.25 * len(kinds), file) as figure:
        figure.suptitle(title)
        axes = figure.subplots(5, 1, sharex=True, height_ratios=heights)
        for axis, (name, key) in zip(axes, RESIDUALS.items(), strict=False):
            axis.plot(minutes, watched.series(key), color="#0b62a4")
            if (limit := limits.limits.get(key)) is not None:
                axis.axhline(limit, color="#d1495b", linestyle="--", linewidth=1.0)
            axis.set_ylabel(f"{name}\n[{_UNITS[name]}]")
        axes[0].set_title("residuals against those of the first 90 s; dashed: limit", fontsize=9.0, loc="left")
        shares = {
            name: value / limits.limits[name]
            for name, value in watched.largest().items()
            if name in limits.limits and name not in RESIDUALS.values()
        }
        for name in sorted(shares, key=lambda one: -shares[one])[:_MOST]:
            axes[3].plot(minutes, watched.series(name) / limits.limits[name], label=name.replace("_", " "))
        axes[3].axhline(1.0, color="#d1495b", linestyle="--", linewidth=1.0)
        axes[3].set_ylim(0.0, min(max([1.2, *shares.values()]) * 1.05, 3.0))
        axes[3].set_ylabel("share\nof limit")
        axes[3].legend(fontsize=7.0, loc="upper left", ncol=_MOST, frameon=False)
        for one in watched.alarms:
            row = kinds.index(one.finding.kind)
            width = (one.end_s - one.begin_s) / 60.0
            axes[4].barh(row, width, left=one.begin_s / 60.0, height=0.6, color="#d1495b", alpha=one.finding.confidence)
        axes[4].set_yticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds], fontsize=8.0)
        axes[4].set_ylim(max(len(kinds), 1) - 0.5, -0.5)
        axes[4].set_title(
            "alarms; the darker, the more certain is the cause" if kinds else "no alarm", fontsize=9.0, loc="left"
        )
        axes[4].set_xlabel("time [min]")
        figure.align_ylabels()
