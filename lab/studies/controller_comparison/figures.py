"""Figures of the comparison."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from controller_comparison.study import CONTROLLERS, CORRIDORS, paper_with
from fsw_analysis.figure_style import CONTROLLERS as LOOKS
from fsw_analysis.figure_style import legend_below, looks_of, sheet
from fsw_analysis.figures import Run, draw, page
from fsw_tuning.standard_runs import JUDGED, Figures, Job, weld


def set_point_steps(path: Path) -> None:
    """The set-point steps of the paper's Fig.

    6 with both controllers as they are shipped, with noise.
    """
    runs = [
        Run(label, weld(Job(label, "reference_tracking", noise=True)))
        for label in ("decentral", "nmpc")
    ]
    page(runs, 6, "Set-point steps of 0.2 mm and 10 °C, with sensor noise", path)


def corridors(folder: Path) -> None:
    """The paper's tuning with each way to start its corridors (32), (33), and one more."""
    runs = []
    for name in ("constant", "cold_start", "recentred", "recentred_ahead"):
        with paper_with(CORRIDORS[name]) as parameters:
            runs.append(Run(name, weld(Job("nmpc", "tracking", parameters=parameters))))
    _, overview = draw(runs, (6,), folder, "corridors")
    overview.unlink()  # it shows the same once more


def fronts(bounds: Mapping[str, Any], nominal: Mapping[str, Any], path: Path) -> None:
    """Per event: the front of the clairvoyant optima, and where the controllers are."""
    with sheet(11.0, 6.6, path) as canvas:
        axes = canvas.subplots(2, 3).flat
        for axis, (name, bound) in zip(axes, bounds.items(), strict=True):
            points = np.array(sorted(bound["front"]))
            axis.plot(points[:, 0], points[:, 1], "k.-", label="clairvoyant optimum")
            for label in CONTROLLERS:
                event = nominal[label]["clean"]["events"][name]
                axis.plot(
                    event["iae_depth_mm_s"],
                    event["iae_temperature_c_s"],
                    **LOOKS[label].point,
                    label=label,
                )
            axis.set(title=name, xlabel="IAE depth [mm s]", ylabel="IAE temperature [°C s]")
        legend_below(canvas, most=3)


def sensors(runs: Mapping[str, Mapping[str, Figures]], path: Path) -> None:
    """The judged errors of every controller with every kind of sensors."""
    kinds, names = list(runs), list(next(iter(runs.values())))
    width = 0.8 / len(names)
    with sheet(11.0, 8.0, path) as canvas:
        axes = canvas.subplots(2, 2, sharex=True).flat
        for axis, (key, title) in zip(axes, JUDGED.items(), strict=True):
            for i, (name, look) in enumerate(zip(names, looks_of(names), strict=True)):
                places = np.arange(len(kinds)) + (i - 0.5 * (len(names) - 1)) * width
                values = [runs[kind][name][key] for kind in kinds]
                axis.bar(places, values, 0.9 * width, **look.bar, label=name)
            axis.set(title=title, ylabel=f"IAE [{'mm s' if 'depth' in key else '°C s'}]")
            axis.set_xticks(
                range(len(kinds)),
                [
                    "\n".join(kind.replace("correlated ", "correlated\n").split(", "))
                    for kind in kinds
                ],
                fontsize=8,
            )
            axis.grid(axis="x", visible=False)
        legend_below(canvas)
