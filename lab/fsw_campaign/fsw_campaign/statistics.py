"""Statistics of a campaign's rows.

Shares with intervals, ratios, rank correlations, the worst welds.
"""

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
from fsw_campaign.dataset import SCENARIO
from fsw_campaign.definition import Bounds, Campaign, Entrant
from fsw_campaign.welds import OK
from fsw_scenario import scenario_file

Vector = NDArray[np.float64]
#: figures by which welds are ranked and parameters are judged
MAIN = ("iae_depth_mm_s", "iae_temperature_c_s")
WORST = 10
_CONFIDENCE = 0.95
#: welds that a group of like parameter values needs, and the most groups
_GROUP, _MOST_GROUPS = 25, 16


def first_order(parameter: Vector, values: Vector) -> float:
    """Share of the variance of the ranks of ``values`` that a parameter alone explains.

    Effect size (eta squared) of the Kruskal-Wallis test over groups of like parameter values,
    which estimates Sobol's first-order index of the ranks; 0 by chance, NaN with too few values.
    """
    from scipy.stats import kruskal

    n, groups = values.size, _groups(values.size)
    if groups < 3 or np.ptp(values) == 0.0:
        return float("nan")
    statistic = kruskal(
        *np.array_split(values[np.argsort(parameter, kind="stable")], groups)
    ).statistic
    return float((statistic - groups + 1) / (n - groups))


def _groups(n: int) -> int:
    return min(n // _GROUP, _MOST_GROUPS)


@dataclass(frozen=True)
class Results:
    """A campaign and its rows, each weld of each controller at most once."""

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
        return [item.label for item in self.campaign.entrants if item.label in self.controller]

    @cached_property
    def complete(self) -> NDArray[np.int64]:
        """Numbers of the welds that finished under all controllers."""
        index, ok = self.table["index"].to_numpy(), self.texts("status") == OK
        return np.flatnonzero(np.bincount(index[ok], minlength=1) == len(self.labels))

    def texts(self, column: str) -> NDArray[np.str_]:
        """A column of text."""
        return np.array(self.table[column].to_pylist(), dtype=str)

    def numbers(self, column: str, label: str) -> Vector:
        """A column of the complete welds of a controller, in order.

        NaN where there is no value.
        """
        chosen = (self.controller == label) & np.isin(
            self.table["index"].to_numpy(), self.complete
        )
        return np.asarray(self.table[column].cast(pa.float64()).to_numpy()[chosen], np.float64)

    @property
    def columns(self) -> list[str]:
        """Columns with figures, on which limits may be set."""
        parameters = self.campaign.distributions
        return [
            column.name
            for column in self.table.schema
            if pa.types.is_floating(column.type) and column.name not in parameters
        ]

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Whether each row is inside all limits of the campaign."""
        return np.asarray(self.table["inside"].to_numpy(zero_copy_only=False), dtype=bool)

    def meets(self, bounds: Mapping[str, Bounds]) -> NDArray[np.bool_] | None:
        """Whether each row ended with figures within bounds, by column.

        None where no row has one of the figures.
        """
        met = self.texts("status") == OK
        for column, bound in bounds.items():
            values = self.table[column].cast(pa.float64()).to_numpy(zero_copy_only=False)
            if not np.isfinite(values).any():
                return None
            met &= bound.hold(values)
        return np.asarray(met)

    def count(self, good: NDArray[np.bool_], label: str) -> tuple[int, int]:
        """How many rows of a controller are good, and how many there are."""
        own = good[self.controller == label]
        return int(own.sum()), int(own.size)

    def ratio(self, column: str, label: str) -> Vector:
        """Ratios of a figure to the first controller's on the same plants, if both are above 0."""
        first, other = self.numbers(column, self.labels[0]), self.numbers(column, label)
        known = (first > 0.0) & (other > 0.0)
        return np.asarray(other[known] / first[known], dtype=np.float64)

    @property
    def figures(self) -> list[str]:
        """Figures of merit that exist in this campaign."""
        return [key for key in ROWS if np.isfinite(self.numbers(key, self.labels[0])).any()]

    def sensitivities(self, column: str, label: str) -> dict[str, tuple[float, float]]:
        """Spearman's correlation and :func:`first_order` of a figure, by numeric parameter.

        NaN where one of the two is constant.
        """
        from scipy.stats import spearmanr

        values = self.numbers(column, label)
        known = np.isfinite(values)
        by_path = {}
        for path, distribution in self.campaign.distributions.items():
            if isinstance(distribution.extremes[0], str):
                continue
            parameter = self.numbers(path, label)[known]
            varies = known.sum() > 2 and np.ptp(parameter) > 0.0 and np.ptp(values[known]) > 0.0
            correlation = (
                float(spearmanr(parameter, values[known]).statistic) if varies else float("nan")
            )
            by_path[path] = (
                correlation,
                first_order(parameter, values[known]) if varies else float("nan"),
            )
        return by_path

    @property
    def chance(self) -> tuple[float, float]:
        """Bounds that correlations and first-order indices exceed by chance in 5 % of cases."""
        from scipy.stats import chi2, norm

        n = max(self.complete.size, 4)
        groups = max(_groups(n), 3)
        correlation = norm.ppf((1.0 + _CONFIDENCE) / 2.0) / (n - 1) ** 0.5
        index = (chi2.ppf(_CONFIDENCE, groups - 1) - groups + 1) / (n - groups)
        return min(float(correlation), 1.0), min(float(index), 1.0)

    def worst(self) -> list[tuple[dict[str, Any], str]]:
        """The worst welds and why.

        First those that did not finish, then by ``MAIN`` over their controller's median.
        """
        medians = {
            label: [np.nanmedian(self.numbers(key, label)) for key in MAIN]
            for label in self.labels
        }
        scored = []
        for row in self.table.drop_columns(["events"]).to_pylist():
            score, why = float("inf"), f"{row['status']}: {row['reason']}"
            if row["status"] == OK:
                ratios = [
                    (row[key] or 0.0) / m if m > 0.0 else 0.0
                    for key, m in zip(MAIN, medians[row["controller"]], strict=True)
                ]
                score, key = max(zip(ratios, MAIN, strict=True), key=lambda pair: pair[0])
                why = f"{ROWS[key][0]} {score:.2f} × median"
            scored.append((-score, row["index"], row["controller"], row, why))
        scored.sort(key=lambda entry: entry[:3])
        return [(row, why) for *_, row, why in scored[:WORST]]

    def command(self, row: Mapping[str, Any]) -> str:
        """Command that runs the weld of a row again."""
        entrant = next(item for item in self.campaign.entrants if item.label == row["controller"])
        return shlex.join(
            ["python3", "scripts/fsw.py", *arguments(self.folder, entrant, self.campaign, row)]
        )


def arguments(
    folder: Path, entrant: Entrant, campaign: Campaign, row: Mapping[str, Any]
) -> list[str]:
    """Arguments of ``fsw.py`` with which the weld of a row is run again."""
    paths = dict.fromkeys(["plant.seed", *campaign.distributions])
    name = campaign.scenario["name"]
    is_shipped = name in scenario_file.shipped() and campaign.scenario == scenario_file.content_of(
        scenario_file.text_of(name)
    )
    words = [
        "simulate",
        name if is_shipped else str(folder / SCENARIO),
        "--controller",
        entrant.controller,
    ]
    for name, value in entrant.parameters.items():
        words += ["--parameter", f"{entrant.name}.{name}={_yaml(value)}"]
    for path in paths:
        words += ["--set", f"{path}={_yaml(row[path])}"]
    return words


def _yaml(value: Any) -> str:
    return (
        yaml.safe_dump(value, default_flow_style=True, width=10_000).removesuffix("...\n").strip()
    )
