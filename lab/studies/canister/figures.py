"""Figures of the study of canisters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from canister.validation import STEP_TIMES_S
from fsw_analysis.figure_style import (
    OTHERS,
    legend_below,
    looks_of,
    shade_phases,
    sheet,
)
from fsw_model import nominal

#: shortest phase whose name has room in the figure
_NAMED_S = 50.0
_SMALL: dict[str, Any] = {"fontsize": 7.0, "color": "dimgray"}
#: in the figure of the steps, what is no canister
_LINES: dict[str, dict[str, Any]] = {
    "paper (16)": {"color": "black", "linestyle": "--"},
    "line source in a plate, no edge": {"color": "grey", "linestyle": ":"},
    "line source in a plate, edge at 60 mm": {"color": "grey", "linestyle": "-."},
}


def draw(data: Mapping[str, Any], path: Path) -> None:
    """Steps, the needed power over the weld, and the error of the reduction."""
    validation = data["validation"]
    with sheet(9.0, 8.5, path) as figure:
        steps, power, wrong = figure.subplots(3, 1, height_ratios=(1.3, 1.0, 0.7))
        _draw_steps(steps, validation["steps"])
        weld, reduced = validation["weld"], validation["reduced"]
        power.plot(np.arange(len(weld["minutes_kw"])) + 0.5, weld["minutes_kw"], "k.-")
        power.axhline(nominal().operating_power_kw, color="grey", linestyle=":")
        power.annotate(
            "paper's operating point", (10.0, nominal().operating_power_kw), **_SMALL, va="bottom"
        )
        power.set(title="needed power, mean of each minute", ylabel="kW")
        wrong.plot(reduced["minutes"], reduced["wrong_c"], color="black", linewidth=0.8)
        wrong.set(
            title="reduced model less all finite elements, stir zone",
            xlabel="time of the weld [min]",
        )
        wrong.set(ylabel="°C", ylim=(-0.55, 0.55))
        for axis in (power, wrong):
            axis.set_xlim(min(reduced["minutes"]) - 0.5, max(reduced["minutes"]) + 0.5)
        shade_phases(
            (power, wrong),
            [(begin / 60.0, end / 60.0) for begin, end in weld["phases_s"].values()],
        )
        for name, (begin, end) in weld["phases_s"].items():
            if end - begin > _NAMED_S:
                power.annotate(
                    name.replace("_", " "),
                    (begin / 60.0 + 0.1, min(weld["minutes_kw"])),
                    **_SMALL,
                    rotation=90,
                )


def draw_shares(data: Mapping[str, Any], path: Path) -> None:
    """The verdict by phase."""
    with sheet(9.0, 3.2, path) as figure:
        _draw_shares(figure.subplots(), data["verdict"])
        legend_below(figure, most=5)


def _draw_steps(axis: Any, steps: Mapping[str, Any]) -> None:
    names = [name for name in steps if name not in _LINES]
    styles = {
        name: {**look.line, "marker": look.marker}
        for name, look in zip(names, OTHERS, strict=False)
    } | _LINES
    for name, of in steps.items():
        axis.plot(
            STEP_TIMES_S, list(of["rise_c"].values()), markersize=4.0, label=name, **styles[name]
        )
    axis.set(
        xscale="log",
        xlabel="time after the step [s]",
        ylabel="°C",
        title="rise of the stir zone by 1 kW more",
    )
    axis.set_xticks(STEP_TIMES_S, [f"{t:g}" for t in STEP_TIMES_S])
    axis.set_xticks([], minor=True)
    axis.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _draw_shares(axis: Any, verdict: Mapping[str, Any]) -> None:
    phases, names = verdict["phases"], tuple(verdict["welds"])
    width = 0.8 / len(names)
    for i, (controller, look) in enumerate(zip(names, looks_of(names), strict=True)):
        shares = [
            100.0 * of[controller]["share_good"] if controller in of else np.nan
            for of in phases.values()
        ]
        places = np.arange(len(phases)) + (i - 0.5 * (len(names) - 1)) * width
        axis.bar(places, shares, 0.9 * width, label=controller, **look.bar)
        for place, share in zip(places, shares, strict=True):
            if np.isfinite(share):
                axis.annotate(f"{share:.0f}", (place, share), ha="center", va="bottom", **_SMALL)
    axis.set_xticks(range(len(phases)), [phase.replace("_", " ") for phase in phases])
    axis.set(
        ylabel="%", ylim=(0.0, 112.0), yticks=range(0, 101, 20), title="welds inside the limits"
    )
    axis.grid(axis="x", visible=False)
