"""The results of the comparison as pages, one per question.

Rows of their tables, for the templates ``*.md.j2``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from controller_comparison.study import (
    FINALISTS,
    KPIS,
    MATCHED,
    TOLERANCE,
    VARIATIONS,
    ratios,
)
from fsw_analysis.report import table, templates
from fsw_tuning.margins import TITLES, texts
from fsw_tuning.standard_cases import (
    CASES,
    CONSERVATIVE,
    DEFAULT,
    DISTURBANCES,
    EVENTS,
    SET_POINTS,
)
from fsw_tuning.standard_runs import JUDGED, failed

Rows = list[list[str]]
#: the pages, each with the part of the data that it cannot do without
PAGES = {
    "README": "matched",
    "other-processes": "sweep",
    "other-models": "other_models",
    "losses": "wins",
    "corridors": "corridors",
    "sensors": "sensing",
}
#: figures of a row at matched margin of which more is better
_MORE_IS_BETTER = ("temperature_gain", "temperature_delay_s")


def worse(data: Mapping[str, Any]) -> list[str]:
    """Where the default NMPC is worse than the conservative PI on the same plant."""
    return [
        f"{name}: {title}, {runs[DEFAULT][key] / runs[CONSERVATIVE][key]:.2f} times"
        for name, runs in data.items()
        for key, title in JUDGED.items()
        if not failed(runs) and runs[DEFAULT][key] > runs[CONSERVATIVE][key]
    ]


def margin_rows(data: Mapping[str, Mapping[str, float]]) -> Rows:
    """Gain and delay margins."""
    rows = [["", *TITLES.values()]]
    for label, cases in data.items():
        words = texts(cases)
        rows.append([label, *(words[key] for key in TITLES)])
    return rows


def matched_rows(data: Mapping[str, Mapping[str, float]]) -> Rows:
    """Margins of the temperature, errors and movements."""
    moved = [KPIS[key] for key in VARIATIONS]
    rows = [
        ["IAE [mm s, °C s], movement", "gain margin", "delay margin", *JUDGED.values(), *moved]
    ]
    for name, of in data.items():
        margins = texts({key: of[key] for key in ("temperature_gain", "temperature_delay_s")})
        iae = [f"{of[key]:.3g}" for key in JUDGED]
        rows.append([name, *margins.values(), *iae, *(f"{of[key]:.0f}" for key in VARIATIONS)])
    return rows


def swinging(data: Mapping[str, Mapping[str, Any]], welds: int) -> list[str]:
    """Sensors with which an output oscillates for good, and in how many welds of a controller."""
    labels = []
    for kind, of in data.items():
        if names := [
            f"{name} ({run['swings']} of {welds} welds)"
            for name, run in of.items()
            if run["swings"]
        ]:
            labels.append(f"{kind}: {', '.join(names)}")
    return labels


def matched_share(data: Mapping[str, Mapping[str, float]], rival: str) -> str:
    """Smallest and largest error of the matched NMPC as shares of a rival's, in words."""
    shares = [100.0 * data[MATCHED][key] / data[rival][key] for key in JUDGED]
    return f"{min(shares):.0f} to {max(shares):.0f} %"


def behind(entrants: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Figures at matched margin in which a PI tuning beats the default NMPC, both values."""
    moved = {key: KPIS[key] for key in VARIATIONS}
    titles = {"temperature_gain": "gain margin", "temperature_delay_s": "delay margin [s]"}
    lost = []
    for key, title in {**titles, **JUDGED, **moved}.items():
        of = {name: entrants[name][key] for name in FINALISTS}
        best = (max if key in _MORE_IS_BETTER else min)(of, key=of.__getitem__)
        if of[best] != of[DEFAULT]:
            lost.append(f"{title}, {of[DEFAULT]:.3g} against {of[best]:.3g} with `{best}`")
    return lost


def over_optimum(own: Mapping[str, Any], bounds: Mapping[str, Any]) -> str:
    """Smallest and largest error of a controller over the optimum's, in an event's output."""
    shares = [
        own["clean"]["events"][name]["iae_depth_mm_s" if event.of_depth else "iae_temperature_c_s"]
        / bounds[name]["joint"][0 if event.of_depth else 1]
        for name, event in EVENTS.items()
    ]
    return f"{min(shares):.2f} to {max(shares):.2f}"


def model_losses(data: Mapping[str, Any]) -> list[str]:
    """On how many models the default NMPC is worse than the better PI tuning, by figure."""
    counts = {
        key: sum(value > 1.0 + TOLERANCE for value in of) for key, of in ratios(data).items()
    }
    return [f"{JUDGED[key]} on {count} models" for key, count in counts.items() if count]


def corridor_rows(data: Mapping[str, Mapping[str, float]]) -> Rows:
    """The temperature with each kind of corridor."""
    heads = (
        "depth steps disturb it, up and down",
        "IAE, set-points",
        "IAE, disturbances",
        "movement of the speed",
    )
    rows = [["temperature", *heads, "gain margin", "delay margin"]]
    for name, of in data.items():
        peaks = [of[f"peak_temperature_in_depth_step_{way}_c"] for way in ("up", "down")]
        cells = [f"{peaks[0]:.2f}, {peaks[1]:.2f} °C", *(f"{of[case]:.0f} °C s" for case in CASES)]
        words = texts({key: of[key] for key in ("temperature_gain", "temperature_delay_s")})
        rows.append([name, *cells, f"{of['speed_rpm']:.0f} rpm", *words.values()])
    return rows


def quantiles(values: Sequence[float]) -> dict[str, float]:
    """Median, 95 % quantile, largest value, and the share at or below 1."""
    array = np.array(values)
    return {
        "median": float(np.median(array)),
        "p95": float(np.quantile(array, 0.95)),
        "largest": float(array.max()),
        "share": float(np.mean(array <= 1.0 + TOLERANCE)),
    }


def random_rows(data: Mapping[str, Sequence[float]]) -> Rows:
    """Distribution of the ratio to the better PI."""
    rows = [
        ["default NMPC over the better PI", "median", "95 %", "largest", "plants at or below 1"]
    ]
    for key, values in data.items():
        q = quantiles(values)
        cells = [
            f"{q['median']:.2f}",
            f"{q['p95']:.2f}",
            f"{q['largest']:.2f}",
            f"{100 * q['share']:.0f} %",
        ]
        rows.append([JUDGED[key], *cells])
    return rows


def loss_rows(losses: Sequence[Sequence[Any]]) -> Rows:
    """By how much figures of merit are lost, and where most."""
    by_kpi: dict[str, list[Sequence[Any]]] = {}
    for loss in sorted(losses, key=lambda loss: -loss[-1]):
        by_kpi.setdefault(loss[3], []).append(loss)
    rows = [["lost", "runs", "median ratio", "largest", "where"]]
    for title, cases in sorted(by_kpi.items(), key=lambda item: -len(item[1])):
        name, case, noise, _, largest = cases[0]
        where = f"{case}{', noise' if noise else ''}, plant {name}"
        rows.append(
            [title, str(len(cases)), f"{cases[len(cases) // 2][-1]:.2f}", f"{largest:.2f}", where]
        )
    return rows


def random_part(data: Mapping[str, Any]) -> dict[str, Any]:
    """What a page shows of random plants."""
    smith = data.get("smith", {})
    return {
        "plants": data["plants"],
        "rows": random_rows(data["ratios"]),
        "swings": data["swings"],
        "smith": {JUDGED[key]: quantiles(values)["median"] for key, values in smith.items()},
    }


def tables(data: Mapping[str, Any]) -> dict[str, Any]:
    """What the pages show of all numbers, without the parts that were not run."""
    shown = {part: data[part] for part in ("matched", "corridors") if part in data}
    if "bounds" in data:
        bounds = data["bounds"]
        shown["optimum"] = {
            "starts": min(bound["starts"] for bound in bounds.values()),
            "spread": max(bound["spread"] for bound in bounds.values()),
            "errors_over_it": over_optimum(data["nominal"][DEFAULT], bounds),
        }
    if "wins" in data:
        wins = data["wins"]
        shown["wins"] = {part: wins[part] for part in ("tuning", "validation")}
        shown["wins"]["rows"] = loss_rows(wins["losses"])
    if "sweep" in data:
        failures = {name: failed(runs) for name, runs in data["sweep"].items()}
        shown["sweep"] = {
            "worse": worse(data["sweep"]),
            "failures": {name: why for name, why in failures.items() if why},
        }
    if "random" in data:
        shown["random"] = random_part(data["random"])
    if "sensing" in data:
        ratios_by_figure = data["sensing"]["random"]["ratios"]
        depth = quantiles(ratios_by_figure["disturbances iae_depth_mm_s"])
        shown["sensing"] = {
            "random": random_part(data["sensing"]["random"]),
            "depth_share": depth["share"],
            "swinging": swinging(data["sensing"]["runs"], 4),
        }
    return shown


def pages(shown: Mapping[str, Any]) -> dict[str, str]:
    """All results as Markdown.

    The text of each page by file name, from :func:`tables` and the numbers of the other models,
    without the pages of parts that were not run.
    """
    environment = templates(Path(__file__).parent)
    environment.globals |= globals()  # the functions above make the rows of tables
    environment.globals |= {"table": table, "set_points": SET_POINTS, "disturbances": DISTURBANCES}
    environment.globals |= {"kpis": KPIS, "default": DEFAULT, "ratios": ratios}
    return {
        f"{name}.md": environment.get_template(f"{name}.md.j2").render(shown)
        for name, part in PAGES.items()
        if part in shown
    }
