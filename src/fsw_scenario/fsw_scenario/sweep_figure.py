"""Figure of controllers on processes that differ from the model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure as Canvas

from fsw_analysis.figure_style import STYLE
from fsw_scenario.standard_cases import CONSERVATIVE, DEFAULT, TIGHT
from fsw_scenario.standard_runs import JUDGED, failed


def draw_sweep(data: Mapping[str, Any], path: Path) -> None:
    """IAE of tight PI and default NMPC over that of the conservative PI, per process."""
    plants = [name for name, runs in data.items() if not failed(runs)]
    with rc_context({**STYLE, "axes.grid": False}):
        canvas = Canvas(figsize=(11.0, 0.32 * len(plants) + 2.2), layout="constrained")
        axes = canvas.subplots(1, 2, sharey=True)
        for axis, label in zip(axes, (TIGHT, DEFAULT), strict=True):
            table = np.array([[data[p][label][key] / data[p][CONSERVATIVE][key] for key in JUDGED] for p in plants])
            image = axis.imshow(np.log2(table), cmap="RdYlGn_r", vmin=-1.5, vmax=1.5, aspect="auto")
            for (row, column), value in np.ndenumerate(table):
                axis.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=8.0)
            axis.set_title(f"{label}: IAE over decentral:conservative", fontsize=10.0)
            axis.set_xticks(range(len(JUDGED)), [title.replace(", ", "\n") for title in JUDGED.values()])
            axis.set_yticks(range(len(plants)), plants)
        bar = canvas.colorbar(image, ax=axes, ticks=[-1, 0, 1], shrink=0.6)
        bar.ax.set_yticklabels(["half", "equal", "double"])
        canvas.savefig(path)
