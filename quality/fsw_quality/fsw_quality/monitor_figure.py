"""Figure of a watched weld.

Disturbances, likelihood of the likeliest fault, alarms, estimated sizes of all faults.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from fsw_analysis.figure_style import BLUE, RED, sheet
from fsw_analysis.weld_signals import FloatArray
from fsw_quality.diagnosis import Estimate
from fsw_quality.monitor import ALARM
from fsw_quality.monitor_run import Watched

_LABELS = "torque\n[N·m]", "force\n[kN]", "heat\n[°C]"
_GREY = "#777777"
#: band that a panel of an estimate shows whole: the narrowest one of the weld, times this
_WIDEST = 6.0


def draw(watched: Watched, title: str, file: Path) -> None:
    """Write the figure: PNG, SVG or PDF."""
    causes = list(dict.fromkeys(alarm.finding.cause for alarm in watched.alarms))
    minutes = np.array(watched.time_s) / 60.0
    with sheet(13.0, 9.0, file) as figure:
        figure.suptitle(title)
        left, right = figure.subfigures(1, 2, width_ratios=[1.2, 1.0], squeeze=False)[0]
        axes = left.subplots(
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
        axes[3].plot(minutes, watched.ratios, color=BLUE)
        axes[3].axhline(ALARM, color=BLUE, linestyle="--", linewidth=1.0)
        axes[3].annotate(
            "alarm", (1.0, ALARM), xycoords=("axes fraction", "data"), ha="right", va="bottom"
        )
        axes[3].set_ylabel("evidence\n[log likelihood]")
        axes[3].set_title("evidence of the likeliest fault", fontsize=9.0, loc="left")
        axes[3].set_ylim(0.0, max(1.5 * ALARM, min(max(watched.ratios), 5.0 * ALARM)))
        for alarm in watched.alarms:
            width = (alarm.end_s - alarm.begin_s) / 60.0
            place = causes.index(alarm.finding.cause)
            axes[4].barh(place, width, left=alarm.begin_s / 60.0, color=RED)
        axes[4].set_yticks(
            range(len(causes)), [cause.word.replace("_", " ") for cause in causes], fontsize=8.0
        )
        axes[4].set_ylim(max(len(causes), 1) - 0.5, -0.5)
        axes[4].set_title("alarms" if causes else "no alarm", fontsize=9.0, loc="left")
        axes[4].set_xlabel("time [min]")
        left.align_ylabels(axes[:4])
        faults = list(zip(*watched.estimates, strict=True))
        right.suptitle(
            "size of each fault if it alone has been there for a minute, ± 2 standard errors\n"
            "(dashed: would be an alarm after a minute)",
            fontsize=9.0,
        )
        panels = right.subplots(len(faults), 1, sharex=True, squeeze=False)[:, 0]
        for panel, fault in zip(panels, faults, strict=True):
            _estimates(panel, minutes, fault)
        panels[-1].set_xlim(axes[0].get_xlim())
        panels[-1].set_xlabel("time [min]")


def _estimates(panel: Axes, minutes: FloatArray, fault: tuple[Estimate, ...]) -> None:
    """Size of a fault with twice its standard error; the smallest one that alarms in a minute."""
    last = fault[-1]
    panel.set_title(f"{last.name} [{last.unit}]", fontsize=8.0, loc="left", pad=2.0)
    panel.tick_params(labelsize=7.0)
    if last.reason:
        panel.set_yticks([])
        panel.annotate(last.text, (0.5, 0.5), xycoords="axes fraction", ha="center", va="center")
        return
    size, error, alarm = np.array([estimate.scaled for estimate in fault]).T
    panel.fill_between(
        minutes, size - 2.0 * error, size + 2.0 * error, color=BLUE, alpha=0.25, linewidth=0.0
    )
    panel.plot(minutes, size, color=BLUE)
    for sign in (-1.0, 1.0):
        panel.plot(minutes, sign * alarm, color=_GREY, linestyle="--", linewidth=0.8)
    most = (
        max(np.nanmax(np.abs(size)) * 1.1, _WIDEST * np.nanmin(error))
        if np.isfinite(error).any()
        else 1.0
    )
    panel.set_ylim(-most, most)
