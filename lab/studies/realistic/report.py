"""Tasks of the study, and its page: intervals of groups of welds beside the published statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.figure_style import looks_of, sheet
from fsw_analysis.phase_kpi import PUBLISHED
from fsw_analysis.report import numbers, templates
from realistic import welds
from realistic.welds import CHOSEN, FITTED, GROUP, STATISTICS, Row, Task

NMPC, CASCADE = "nmpc:default", "decentral"
#: published rows that are predicted, and their emulation
EARLIER = {
    "manual axial force": "realistic.earlier:ByHand",
    "demonstration series": "realistic.earlier:OftenByHand",
    "first controller": "realistic.earlier:SingleLoop",
}
#: welds of the campaign, none of which the fit uses: with the cascade, each other controller, and
#: of each variation
CASCADE_WELDS, OTHER_WELDS, VARIED_WELDS = range(100, 124), range(100, 112), range(100, 103)
FACTORS = (0.5, 1.5)
#: welds with either controller that a variation must have, to be shown
_FEWEST = 1
WORDS = {
    welds.FALL: "fall of the needed power",
    welds.HEAT: "size of the random heat",
    welds.HEAT_S: "time of the random heat",
    welds.TORQUE: "size of the random torque",
    welds.TORQUE_S: "time of the random torque",
    "plant.canister.tool_share": "needed power between welds",
    "plant.factors.sliding_friction": "friction between welds",
}
UNITS = {
    welds.FALL: "°C",
    welds.HEAT: "°C",
    welds.HEAT_S: "s",
    welds.TORQUE: "N·m",
    welds.TORQUE_S: "s",
}


def tasks(share: float = 1.0) -> list[Task]:
    """All welds, the most important first; ``share`` of them for a trial, at least two of each."""

    def some(indices: range) -> range:
        return indices[: max(2, round(share * len(indices)))]

    rivals = (NMPC, *EARLIER.values())
    most = some(CASCADE_WELDS)
    made = [Task(label, i) for i in most[:2] for label in (CASCADE, *rivals)]
    made += [Task(label, i) for i in most[2:GROUP] for label in (CASCADE, NMPC)]
    made += [
        Task(label, index, ((path, factor),))
        for index in some(VARIED_WELDS)
        for path in CHOSEN
        for factor in FACTORS
        for label in (CASCADE, NMPC)
    ]
    made += [Task(label, i) for i in some(OTHER_WELDS)[2:] for label in rivals]
    made += [Task(CASCADE, i) for i in most]
    return list(dict.fromkeys(made))


def content(rows: Sequence[Row], fitted: Mapping[str, Any]) -> dict[str, Any]:
    """All numbers of the page."""
    plain = [row for row in rows if not row["changes"]]
    series = {}
    for name, label in {"cascade": CASCADE, **EARLIER, NMPC: NMPC}.items():
        own = [row for row in plain if row["controller"] == label]
        if not own:
            continue
        size, statistics = PUBLISHED.get(name, PUBLISHED["cascade"])
        published = list(astuple(statistics))
        found = welds.intervals(welds.groups(own, size))
        series[name] = {
            "welds": len(own),
            "group": size,
            "intervals": found,
            "published": published if name in PUBLISHED else None,
            "outside": _outside(found, published) if name in PUBLISHED else [],
            "within": sum(row["min_c"] >= -10.0 and row["max_c"] <= 10.0 for row in own),
            "stopped": sum(bool(row["stopped"]) for row in own),
            "depth_um": float(np.median([row["depth_um"] for row in own])),
            "moved_rpm_per_min": float(np.median([row["moved_rpm_per_min"] for row in own])),
            "power_kw": np.mean([row["power_kw"] for row in own], 0).tolist(),
        }
    return {
        "series": series,
        "shares": {NMPC: share_of(plain, NMPC)},
        "varied": _varied(rows),
        "values": welds.scenario_values(),
        "fit": dict(fitted),
        "software": sorted({row["software"] for row in rows}),
    }


def _outside(found: Mapping[str, list[float]], published: Sequence[float]) -> list[str]:
    """Published statistics outside their interval; those that its end rounds to are marked."""
    names = []
    for name, value in zip(STATISTICS, published, strict=True):
        low, _, high = found[name]
        if not low <= value <= high:
            digits = len(f"{value:g}".partition(".")[2])
            rounded = value in (round(low, digits), round(high, digits))
            names.append(f"{name} (inside if rounded)" if rounded else name)
    return names


def share_of(rows: Sequence[Row], label: str) -> dict[str, list[float]]:
    """A controller's sigma and range as a share of the cascade's on the same welds, with intervals.

    The groups of eight are the same welds for both.
    """
    by_controller = [
        {row["index"]: row for row in rows if row["controller"] == name}
        for name in (label, CASCADE)
    ]
    common = sorted(set(by_controller[0]) & set(by_controller[1]))
    own, rival = (welds.groups([of[index] for index in common], GROUP) for of in by_controller)
    ranges = [found[:, 3] - found[:, 2] for found in (own, rival)]
    return {
        name: [float(value) for value in np.percentile(share, (2.5, 50.0, 97.5))]
        for name, share in (("sigma", own[:, 1] / rival[:, 1]), ("range", ranges[0] / ranges[1]))
    }


def _varied(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """By parameter and factor, the cascade's medians and the default NMPC's share of its sigma."""
    varied = []
    for path in CHOSEN:
        for factor in FACTORS:
            own = [row for row in rows if row["changes"] == [[path, factor]]]
            cascade = [row for row in own if row["controller"] == CASCADE]
            if min(len(cascade), len(own) - len(cascade)) >= _FEWEST:
                found = welds.intervals(welds.groups(cascade, GROUP))
                varied.append(
                    {
                        "parameter": WORDS[path],
                        "factor": factor,
                        "welds": len(cascade),
                        "cascade": {name: found[name][1] for name in STATISTICS},
                        "share": share_of(own, NMPC),
                    }
                )
    return varied


def table(data: Mapping[str, Any]) -> list[list[str]]:
    """The page's table."""
    rows = [["temperature on the joint line [°C]", "welds", "mean", "σ", "least", "largest"]]
    kinds = {"cascade": "emulated, fitted"} | dict.fromkeys(EARLIER, "predicted")
    for name, one in data["series"].items():
        if one["published"]:
            texts = [f"{value:+g}" for value in one["published"]]
            rows.append([f"**{name}, published**", f"{one['group']}", *_signless(texts)])
        cells = [_cell(one["intervals"][key]) for key in STATISTICS]
        label = f"{name}, {kinds[name]}" if name in kinds else f"`{name}`, predicted"
        rows.append([label, f"{one['group']}", *_signless(cells)])
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
    places = {"words": WORDS, "units": UNITS, "FITTED": FITTED, "CHOSEN": CHOSEN, "NMPC": NMPC}
    text = template.render(data, rows=table(data), groups=welds.GROUPS, **places)
    return text.rstrip("\n") + "\n"


def draw(data: Mapping[str, Any], path: Path) -> None:
    """The intervals beside the published statistics, and the answer under variations."""
    with sheet(9.0, 3.8, path) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
        names = list(data["series"])
        for place, (name, look) in enumerate(zip(names, looks_of(tuple(names)), strict=True)):
            one = data["series"][name]
            low, high = one["intervals"]["min"], one["intervals"]["max"]
            left.plot(
                [place, place],
                [low[1], high[1]],
                color=look.colour,
                linewidth=6.0,
                solid_capstyle="butt",
            )
            left.plot([place, place], [low[0], high[2]], color=look.colour, linewidth=1.0)
            if one["published"]:
                left.plot([place, place], one["published"][2:], "k_", markersize=14.0)
        left.set_xticks(range(len(names)), names, rotation=30, ha="right", fontsize=7.0)
        left.set(title="least and largest error (black: published)", ylabel="°C")
        left.axhspan(-10.0, 10.0, color="grey", alpha=0.15)
        for place, one in enumerate(data["varied"]):
            low, middle, high = one["share"]["sigma"]
            right.plot([low, high], [place, place], color="grey", linewidth=1.0)
            right.plot(middle, place, "o", color="black", markersize=4.0)
        own = data["shares"][NMPC]["sigma"]
        right.axvspan(own[0], own[2], color="grey", alpha=0.2)
        right.axvline(1.0, color="black", linestyle=":")
        right.set_yticks(
            range(len(data["varied"])),
            [f"{one['parameter']} × {one['factor']}" for one in data["varied"]],
            fontsize=7.0,
        )
        right.set(title="σ of nmpc:default / σ of the cascade")


def write(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the page, its figure and its numbers."""
    texts = {"realistic.md": page(data), "realistic_tables.json": numbers(data)}
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")
    draw(data, folder / "realistic.png")
    return [folder / file for file in (*texts, "realistic.png")]
