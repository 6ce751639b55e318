"""Figures of the comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from controller_comparison.study import CONTROLLERS, CORRIDORS, paper_with
from fsw_analysis.figure_style import COLOURS, CONTROLLER_COLOURS, sheet
from fsw_analysis.figures import Run, draw, draw_outputs
from fsw_tuning.standard_runs import JUDGED, Job, weld


def papers(folder: Path) -> None:
    """The paper's Figs. 6 to 9, with all controllers, without noise, and the study that it only mentions."""
    for case, numbers in (
        ("tracking", (6, 7)),
        ("disturbances", (8, 9)),
        ("model_uncertainty", (6, 7)),
    ):
        _draw([Run(label, weld(Job(label, case))) for label in CONTROLLERS], numbers, folder, case)


def set_point_steps(path: Path) -> None:
    """The set-point steps of the paper's Fig. 6 with both controllers as they are shipped, with noise."""
    runs = [
        Run(label, weld(Job(label, "reference_tracking", noise=True)))
        for label in ("decentral", "nmpc")
    ]
    draw_outputs(runs, "Set-point steps of 0.2 mm and 10 °C, with sensor noise", path)


def corridors(folder: Path) -> None:
    """The paper's tuning with each way to start its corridors (32), (33), which the text leaves open, and one more."""
    runs = []
    for name in ("constant", "cold_start", "recentred", "recentred_ahead"):
        with paper_with(CORRIDORS[name]) as parameters:
            runs.append(Run(name, weld(Job("nmpc", "tracking", parameters=parameters))))
    _draw(runs, (6, 7), folder, "corridors")


def _draw(runs: list[Run], numbers: Sequence[int], folder: Path, name: str) -> None:
    *_, overview = draw(runs, numbers, folder, name)
    overview.unlink()  # it shows the same once more


def fronts(bounds: Mapping[str, Any], nominal: Mapping[str, Any], path: Path) -> None:
    """Per event: the front of the clairvoyant optima, and where the controllers are."""
    with sheet(11.0, 6.6, path) as canvas:
        axes = canvas.subplots(2, 3).flat
        for axis, (name, found) in zip(axes, bounds.items(), strict=True):
            points = np.array(sorted(found["front"]))
            axis.plot(points[:, 0], points[:, 1], "k.-", label="clairvoyant optimum")
            for label in CONTROLLERS:
                event, colour = nominal[label]["clean"]["events"][name], CONTROLLER_COLOURS[label]
                axis.plot(
                    event["iae_depth_mm_s"],
                    event["iae_temperature_c_s"],
                    "o",
                    color=colour,
                    label=label,
                )
            axis.set(title=name, xlabel="IAE depth [mm s]", ylabel="IAE temperature [°C s]")
        handles, labels = canvas.axes[0].get_legend_handles_labels()
        canvas.set_layout_engine("constrained", rect=(0.0, 0.05, 1.0, 0.95))
        canvas.legend(handles, labels, loc="lower center", ncols=6, frameon=False)


def random_plants(data: Mapping[str, Any], path: Path) -> None:
    """Distribution of the default NMPC's IAE over the better PI's."""
    with sheet(8.0, 4.2, path) as canvas:
        axis = canvas.subplots()
        for colour, (key, values) in zip(COLOURS, data["ratios"].items(), strict=False):
            axis.plot(
                np.sort(values),
                np.linspace(0.0, 100.0, len(values)),
                color=colour,
                label=JUDGED[key],
            )
        axis.axvline(1.0, color="black", linewidth=0.8)
        axis.set(
            xlabel="IAE, default NMPC over the better PI tuning",
            ylabel="plants [%]",
            title=f"{data['plants']} random plants, sensor noise on",
            xscale="log",
        )
        ticks = [0.5, 0.7, 1.0, 1.4, 2.0]
        axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.minorticks_off()
        axis.legend(loc="lower right")
