"""Figures of the study of canisters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from canister.validation import STEP_TIMES_S
from fsw_analysis.figure_style import (
    OTHERS,
    shade_phases,
    sheet,
)
from fsw_model import nominal

_SMALL: dict[str, Any] = {"fontsize": 7.0, "color": "dimgray"}
#: in the figure of the steps, what is no canister
_LINES: dict[str, dict[str, Any]] = {
    "paper (16)": {"color": "black", "linestyle": "--"},
    "line source in a plate, no edge": {"color": "grey", "linestyle": ":"},
    "line source in a plate, edge at 60 mm": {"color": "grey", "linestyle": "-."},
}


def draw(content: Mapping[str, Any], path: Path) -> None:
    """Steps, the needed power over the weld, and the error of the reduction by phase."""
    with sheet(9.0, 8.5, path) as figure:
        steps, power, wrong = figure.subplots(3, 1, height_ratios=(1.3, 1.0, 0.7))
        _draw_steps(steps, content["steps_c"])
        _draw_power(power, content["weld"])
        largest_c = content["reduced"]["phases_c"]
        bars = wrong.bar(
            [name.replace("_", " ") for name in largest_c], largest_c.values(), 0.5, color="0.4"
        )
        wrong.bar_label(bars, fmt="%.2f", fontsize=8)
        wrong.set(
            title="reduced model less all finite elements, stir zone: largest by phase",
            ylabel="°C",
            ylim=(0.0, 1.25 * max(largest_c.values())),
        )
        wrong.grid(axis="x", visible=False)


def _draw_power(axis: Any, weld: Mapping[str, Any]) -> None:
    means_kw = weld["minutes_kw"]
    axis.plot(np.arange(len(means_kw)) + 0.5, means_kw, "k.-")
    axis.axhline(nominal().operating_power_kw, color="grey", linestyle=":")
    axis.annotate(
        "paper's operating point", (10.0, nominal().operating_power_kw), **_SMALL, va="bottom"
    )
    axis.set(
        title="needed power, mean of each minute", ylabel="kW", xlabel="time of the weld [min]"
    )
    axis.set_xlim(-0.5, len(means_kw) + 0.5)
    phases_s = weld["phases_s"]
    phases = [(name, begin / 60.0, end / 60.0) for name, (begin, end) in phases_s.items()]
    shade_phases((axis,), phases)


def _draw_steps(axis: Any, steps: Mapping[str, Any]) -> None:
    names = [name for name in steps if name not in _LINES]
    styles = {
        name: {**look.line, "marker": look.marker}
        for name, look in zip(names, OTHERS, strict=False)
    } | _LINES
    for name, rises_c in steps.items():
        axis.plot(STEP_TIMES_S, list(rises_c.values()), markersize=4.0, label=name, **styles[name])
    axis.set(
        xscale="log",
        xlabel="time after the step [s]",
        ylabel="°C",
        title="rise of the stir zone by 1 kW more",
    )
    axis.set_xticks(STEP_TIMES_S, [f"{t:g}" for t in STEP_TIMES_S])
    axis.set_xticks([], minor=True)
    axis.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
