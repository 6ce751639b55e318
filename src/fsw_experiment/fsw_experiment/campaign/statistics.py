"""What the rows of a campaign say: shares with intervals, ratios, rank correlations, the worst welds."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import yaml
from numpy.typing import NDArray

from fsw_analysis.kpi_table import ROWS
from fsw_experiment import scenario_file
from fsw_experiment.campaign.dataset import SCENARIO
from fsw_experiment.campaign.definition import Campaign, Entrant
from fsw_experiment.campaign.welds import OK

Vector = NDArray[np.float64]
#: figures by which welds are ranked and parameters are judged
MAIN = ("iae_depth_mm_s", "iae_temperature_c_s")
#: of the intervals of shares
_CONFIDENCE = 0.95
WORST = 10


@dataclass(frozen=True)
class Results:
    """A campaign and its rows, each weld of each controller at most once.

    Attributes
    ----------
    campaign : Campaign
    table : pyarrow.Table
    folder : Path
    """

    campaign: Campaign
    table: pa.Table
    folder: Path

    @cached_property
    def controller(self) -> NDArray[np.str_]:
        """Label of each row's controller."""
        return np.array(self.table["controller"].to_pylist(), dtype=str)

    @cached_property
    def labels(self) -> list[str]:
        """Labels of the controllers, in the campaign's order."""
        return [one.label for one in self.campaign.entrants if one.label in self.controller]

    @cached_property
    def complete(self) -> NDArray[np.int64]:
        """Numbers of the welds that all controllers have run to their end."""
        index, ok = self.table["index"].to_numpy(), self.texts("status") == OK
        return np.flatnonzero(np.bincount(index[ok], minlength=1) == len(self.labels))

    def texts(self, column: str) -> NDArray[np.str_]:
        """A column of text."""
        return np.array(self.table[column].to_pylist(), dtype=str)

    def numbers(self, column: str, label: str) -> Vector:
        """A column of the complete welds of a controller, in order; NaN where there is no value."""
        chosen = (self.controller == label) & np.isin(self.table["index"].to_numpy(), self.complete)
        found = self.table[column].cast(pa.float64()).to_numpy()[chosen]
        return np.asarray(found, dtype=np.float64)

    def share(self, label: str) -> tuple[int, int, float, float]:
        """Welds inside all limits, all welds, and the Wilson interval (95 %) of the share."""
        from scipy.stats import binomtest

        inside = self.table["inside"].to_numpy(zero_copy_only=False)[self.controller == label].astype(bool)
        good, total = int(inside.sum()), int(inside.size)
        interval = binomtest(good, total).proportion_ci(_CONFIDENCE, method="wilson")
        return good, total, float(interval.low), float(interval.high)

    def ratio(self, column: str, label: str) -> Vector:
        """Ratios of a figure to that of the first controller on the same plants, where both are above 0."""
        first, other = self.numbers(column, self.labels[0]), self.numbers(column, label)
        known = (first > 0.0) & (other > 0.0)
        return np.asarray(other[known] / first[known], dtype=np.float64)

    @property
    def figures(self) -> list[str]:
        """Figures of merit that exist in this campaign."""
        return [key for key in ROWS if np.isfinite(self.numbers(key, self.labels[0])).any()]

    def correlations(self, column: str, label: str) -> dict[str, float]:
        """Spearman's rank correlation of a figure with each parameter that is a number; NaN where one is constant."""
        from scipy.stats import spearmanr

        values = self.numbers(column, label)
        known = np.isfinite(values)
        found = {}
        for one in self.campaign.distributions:
            if isinstance(one.extremes[0], str):
                continue
            parameter = self.numbers(one.path, label)[known]
            varies = known.sum() > 2 and np.ptp(parameter) > 0.0 and np.ptp(values[known]) > 0.0
            found[one.path] = float(spearmanr(parameter, values[known]).statistic) if varies else float("nan")
        return found

    def worst(self) -> list[tuple[dict[str, Any], str]]:
        """The worst welds and why: first those that did not end, then by ``MAIN`` over their controller's median."""
        rows = self.table.drop_columns(["events"]).to_pylist()
        medians = {label: [np.nanmedian(self.numbers(key, label)) for key in MAIN] for label in self.labels}
        scored = []
        for row in rows:
            if row["status"] != OK:
                scored.append((float("inf"), row, f"{row['status']}: {row['reason']}"))
                continue
            ratios = [(row[key] or 0.0) / m for key, m in zip(MAIN, medians[row["controller"]], strict=True) if m > 0.0]
            which = int(np.argmax(ratios)) if ratios else 0
            why = f"{ROWS[MAIN[which]][0]} {max(ratios, default=0.0):.2f} × median"
            scored.append((max(ratios, default=0.0), row, why))
        scored.sort(key=lambda one: (-one[0], one[1]["index"], one[1]["controller"]))
        return [(row, why) for _, row, why in scored[:WORST]]

    def command(self, row: Mapping[str, Any]) -> str:
        """Command that runs the weld of a row again."""
        entrant = next(one for one in self.campaign.entrants if one.label == row["controller"])
        return shlex.join(["python3", "scripts/fsw.py", *arguments(self.folder, entrant, self.campaign, row)])


def arguments(folder: Path, entrant: Entrant, campaign: Campaign, row: Mapping[str, Any]) -> list[str]:
    """Arguments of ``fsw.py`` with which the weld of a row is run again."""
    paths = dict.fromkeys(["plant.seed", *(one.path for one in campaign.distributions)])
    name = campaign.scenario["name"]
    is_shipped = name in scenario_file.shipped() and campaign.scenario == scenario_file.content_of(
        scenario_file.text_of(name)
    )
    found = ["simulate", name if is_shipped else str(folder / SCENARIO), "--controller", entrant.controller]
    for name, value in entrant.parameters.items():
        found += ["--parameter", f"{entrant.name}.{name}={_yaml(value)}"]
    for path in paths:
        found += ["--set", f"{path}={_yaml(row[path])}"]
    return found


def _yaml(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True, width=10_000).removesuffix("...\n").strip()
