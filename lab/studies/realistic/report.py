"""Tasks of the study, and its page.

Intervals of groups of welds beside the published statistics.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.figure_style import looks_of, sheet
from fsw_analysis.phase_kpi import PUBLISHED
from fsw_analysis.report import numbers, templates
from realistic import welds
from realistic.fit import CONVERGED
from realistic.welds import CHOSEN, FITTED, GROUP, STATISTICS, Row, Task

NMPC, CASCADE = "nmpc:default", "decentral"
#: published rows that are predicted, and their emulation
EARLIER = {
    "manual axial force": "realistic.earlier:ByHand",
    "demonstration series": "realistic.earlier:OftenByHand",
    "first controller": "realistic.earlier:SingleLoop",
}
#: welds of the campaign, none of which the fit uses: with the cascade, the NMPC, each earlier
#: control, and of each variation
CASCADE_WELDS, NMPC_WELDS = range(16, 216), range(16, 64)
EARLIER_WELDS, VARIED_WELDS = range(16, 24), range(16, 18)
FACTORS = (0.5, 1.5)
#: with which the earlier control is predicted, too: the cascade's mean may have another cause
HALF_FALL = ((welds.FALL, 0.5),)
#: welds with either controller that a variation must have, to be shown
_FEWEST = 1
#: name and unit of each parameter that is fitted or varied
PARAMETERS = {
    welds.FALL: ("fall of the needed power", "°C"),
    welds.HEAT: ("size of the random heat", "°C"),
    welds.HEAT_SCATTER: ("random heat between welds", "°C"),
    welds.HEAT_S: ("time of the random heat", "s"),
    welds.TORQUE: ("size of the random torque", "N·m"),
    welds.TORQUE_S: ("time of the random torque", "s"),
    welds.TOOL_SCATTER: ("needed power between welds", ""),
    welds.FRICTION_SCATTER: ("friction between welds", ""),
    welds.FALL_SCATTER: ("fall of the power between welds", "°C"),
}


def tasks(share: float = 1.0) -> list[Task]:
    """All welds, the most important first; ``share`` of them for a trial, at least two of each."""

    def some(indices: range) -> range:
        return indices[: max(2, round(share * len(indices)))]

    made = [Task(label, i) for i in some(CASCADE_WELDS)[:GROUP] for label in (CASCADE, NMPC)]
    made += [Task(CASCADE, i) for i in some(CASCADE_WELDS)]
    made += [Task(NMPC, i) for i in some(NMPC_WELDS)[: len(NMPC_WELDS) // 2]]
    made += [Task(label, i) for i in some(EARLIER_WELDS)[:4] for label in EARLIER.values()]
    made += [
        Task(label, i, HALF_FALL) for i in some(EARLIER_WELDS)[:4] for label in EARLIER.values()
    ]
    made += [
        Task(label, index, ((name, factor),))
        for index in some(VARIED_WELDS)
        for name in CHOSEN
        for factor in FACTORS
        for label in (CASCADE, NMPC)
    ]
    made += [Task(label, i) for i in some(EARLIER_WELDS) for label in EARLIER.values()]
    made += [Task(NMPC, i) for i in some(NMPC_WELDS)]
    return list(dict.fromkeys(made))


def content(rows: Sequence[Row], fitted: Mapping[str, Any]) -> dict[str, Any]:
    """All numbers of the page."""
    plain = [row for row in rows if not row["changes"]]
    by_nmpc = {row["index"] for row in plain if row["controller"] == NMPC}
    series = {}
    for name, label in {"cascade": CASCADE, **EARLIER, NMPC: NMPC}.items():
        own = [row for row in plain if row["controller"] == label]
        if not own:
            continue
        size, statistics = PUBLISHED.get(name, PUBLISHED["cascade"])
        published = list(astuple(statistics))
        intervals = welds.intervals(welds.groups(own, size))
        series[name] = {
            "welds": len(own),
            "group": size,
            "intervals": intervals,
            "published": published if name in PUBLISHED else None,
            "outside": _outside(intervals, published) if name in PUBLISHED else [],
            "within": _within(own),
            "stopped": sum(bool(row["stopped"]) for row in own),
            "depth_um": float(np.median([row["depth_um"] for row in own])),
            "moved_rpm_per_min": float(np.median([row["moved_rpm_per_min"] for row in own])),
            "power_kw": np.mean([row["power_kw"] for row in own], 0).tolist(),
        }
    return {
        "series": series,
        "shares": {NMPC: share_of(plain, NMPC)},
        "cascade_within_on_welds_of_nmpc": _within(
            [row for row in plain if row["controller"] == CASCADE and row["index"] in by_nmpc]
        ),
        "varied": _varied(rows),
        "half_fall": _half_fall(rows),
        "values": welds.shipped_values(),
        "fit": dict(fitted),
        "software": sorted({row["software"] for row in rows}),
    }


def _within(rows: Sequence[Row]) -> int:
    """Welds within 10 degC over the whole joint line, as published."""
    return sum(row["min_c"] >= -10.0 and row["max_c"] <= 10.0 for row in rows)


def _outside(intervals: Mapping[str, list[float]], published: Sequence[float]) -> list[str]:
    """Published statistics outside their interval; those that its end rounds to are marked."""
    names = []
    for name, value in zip(STATISTICS, published, strict=True):
        low, _, high = intervals[name]
        if not low <= value <= high:
            digits = len(f"{value:g}".partition(".")[2])
            rounded = value in (round(low, digits), round(high, digits))
            names.append(f"{name} (inside if rounded)" if rounded else name)
    return names


def share_of(rows: Sequence[Row], label: str) -> dict[str, list[float]]:
    """A controller's sigma and range over the cascade's on the same welds, with intervals.

    And the change of the mean [degC]. The groups of eight are the same welds for both.
    """
    by_controller = [
        {row["index"]: row for row in rows if row["controller"] == name}
        for name in (label, CASCADE)
    ]
    common = sorted(set(by_controller[0]) & set(by_controller[1]))
    own, rival = (welds.groups([of[index] for index in common], GROUP).T for of in by_controller)
    compared = {
        "mean_change_c": own[0] - rival[0],
        "sigma": own[1] / rival[1],
        "range": (own[3] - own[2]) / (rival[3] - rival[2]),
    }
    return {
        name: [float(value) for value in np.percentile(values, (2.5, 50.0, 97.5))]
        for name, values in compared.items()
    }


def _half_fall(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Medians of the earlier control's statistics if the power falls by half as much."""
    changes = [list(change) for change in HALF_FALL]
    of_all = {
        name: [row for row in rows if row["controller"] == label and row["changes"] == changes]
        for name, label in EARLIER.items()
    }
    return {
        name: {
            key: middle
            for key, (_, middle, _) in welds.intervals(
                welds.groups(own, PUBLISHED[name][0])
            ).items()
        }
        for name, own in of_all.items()
        if own
    }


def _varied(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """By parameter and factor, the cascade's medians and the default NMPC's share of its sigma."""
    varied = []
    for name in CHOSEN:
        for factor in FACTORS:
            own = [row for row in rows if row["changes"] == [[name, factor]]]
            cascade = [row for row in own if row["controller"] == CASCADE]
            if min(len(cascade), len(own) - len(cascade)) >= _FEWEST:
                intervals = welds.intervals(welds.groups(cascade, GROUP))
                varied.append(
                    {
                        "parameter": PARAMETERS[name][0],
                        "factor": factor,
                        "welds": len(cascade),
                        "cascade": {key: intervals[key][1] for key in STATISTICS},
                        "share": share_of(own, NMPC),
                    }
                )
    return varied


def table(data: Mapping[str, Any]) -> list[list[str]]:
    """The page's table."""
    rows = [["temperature on the joint line [°C]", "welds", "mean", "σ", "least", "largest"]]
    kinds = {"cascade": "emulated, fitted"} | dict.fromkeys(EARLIER, "predicted")
    for name, series in data["series"].items():
        if series["published"]:
            texts = [f"{value:+g}" for value in series["published"]]
            rows.append([f"**{name}, published**", f"{series['group']}", *_signless(texts)])
        cells = [_cell(series["intervals"][key]) for key in STATISTICS]
        label = f"{name}, {kinds[name]}" if name in kinds else f"`{name}`, predicted"
        rows.append([label, f"{series['group']}", *_signless(cells)])
    return rows


def _cell(interval: Sequence[float]) -> str:
    digits = ".2f" if max(map(abs, interval)) < 2.0 else ".1f"
    low, middle, high = (f"{value:+{digits}}" for value in interval)
    return f"{middle} ({low} to {high})"


def _signless(cells: list[str]) -> list[str]:
    """Without the signs of sigma."""
    return [cells[0], cells[1].replace("+", ""), *cells[2:]]


def page(data: Mapping[str, Any]) -> str:
    """The page."""
    template = templates(Path(__file__).parent).get_template("realistic.md.j2")
    names = {"parameters": PARAMETERS, "FITTED": FITTED, "CHOSEN": CHOSEN, "NMPC": NMPC}
    figures = {"groups": welds.GROUPS, "GROUP": GROUP, "CONVERGED": CONVERGED}
    text = template.render(data, rows=table(data), **names, **figures)
    return text.rstrip("\n") + "\n"


def draw(data: Mapping[str, Any], path: Path) -> None:
    """The intervals beside the published statistics, and the answer under variations."""
    with sheet(9.0, 3.8, path) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
        names = list(data["series"])
        for place, (name, look) in enumerate(zip(names, looks_of(tuple(names)), strict=True)):
            series = data["series"][name]
            low, high = series["intervals"]["min"], series["intervals"]["max"]
            left.plot(
                [place, place],
                [low[1], high[1]],
                color=look.colour,
                linewidth=6.0,
                solid_capstyle="butt",
            )
            left.plot([place, place], [low[0], high[2]], color=look.colour, linewidth=1.0)
            if series["published"]:
                left.plot([place, place], series["published"][2:], "k_", markersize=14.0)
        left.set_xticks(range(len(names)), names, rotation=30, ha="right", fontsize=7.0)
        left.set(title="least and largest error (black: published)", ylabel="°C")
        left.axhspan(-10.0, 10.0, color="grey", alpha=0.15)
        for place, row in enumerate(data["varied"]):
            low, middle, high = row["share"]["sigma"]
            right.plot([low, high], [place, place], color="grey", linewidth=1.0)
            right.plot(middle, place, "o", color="black", markersize=4.0)
        own = data["shares"][NMPC]["sigma"]
        right.axvspan(own[0], own[2], color="grey", alpha=0.2)
        right.axvline(1.0, color="black", linestyle=":")
        right.set_yticks(
            range(len(data["varied"])),
            [f"{row['parameter']} × {row['factor']}" for row in data["varied"]],
            fontsize=7.0,
        )
        right.set(title="σ of nmpc:default / σ of the cascade")


def write(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the page, its figure and its numbers."""
    shown = numbers(data)  # rounded: the page follows from the file
    texts = {"realistic.md": page(json.loads(shown)), "realistic_tables.json": shown}
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")
    draw(data, folder / "realistic.png")
    return [folder / file for file in (*texts, "realistic.png")]
