"""The results as pages: rows of the tables, and what the pages show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from canister.figures import draw, draw_shares
from canister.validation import STEP_TIMES_S, THERMAL
from canister.verdict import AT_MOST_S, DEPTH_MM, TEMPERATURE_C, WINDOW_C, Row
from fsw_analysis.report import numbers, templates
from fsw_campaign.report import wilson
from fsw_heat.compaction import TOLERANCE_K
from fsw_model import nominal

PI = ("decentral:conservative", "decentral:tight")
CONTROLLERS = ("nmpc:default", "nmpc:paper", *PI, "decentral:smith")
#: 40 of the 45 minutes
LONG_PHASES = ("joint_line", "overlap")
PHASES = ("dwell", "start", "downward", "joint_line", "overlap", "parking")
#: published or plain words for the columns of the page
FIGURES = {
    "temperature_sigma_c": ("RMS error of the temperature [°C]", 1.0, ".2f"),
    "temperature_peak_c": ("largest error of the temperature [°C]", 1.0, ".1f"),
    "depth_sigma_mm": ("RMS error of the depth [µm]", 1e3, ".1f"),
    "moved_kn": ("movement of the force [kN/min]", 60.0, ".0f"),
    "moved_rpm": ("movement of the speed [rpm/min]", 60.0, ".0f"),
    "fastest_s": ("time at the drives' highest speed [% of the phase]", 100.0, ".1f"),
}
#: time at a drive's limit from which a canister needs more than the drive gives [s]
_LONG_S = 60.0
#: error of the depth over the joint line, RMS, of a loop that oscillates for good; the others have
#: a few µm (chosen)
_OSCILLATES_MM = 0.02
#: the campaign's limit on the time outside, for the second row [s]
_LONGER_S = 30.0
#: minutes of the weld in the table of the copper's properties
_COPPER_MIN = (5.0, 10.0, 20.0, 40.0)
#: rows of the table of canisters that no controller can weld within the limits
_SHOWN = 4
#: figures that are for the length of a phase; of these the mean is shown, of the others the median
_PER_TIME = ("moved_kn", "moved_rpm", "fastest_s")


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Number of welds, and by phase and controller the share inside the limits and the figures.

    Controllers that have welded nothing are left out.
    """
    controllers = [
        label for label in CONTROLLERS if any(row["controller"] == label for row in rows)
    ]
    verdict: dict[str, Any] = {
        "welds": {},
        "stopped": {},
        "phases": {},
        "saturated": _saturated(rows),
    }
    line = [row for row in rows if row["phase"] == "joint_line"]
    verdict["oscillating"] = {
        controller: [1e3 * row["depth_sigma_mm"] for row in line if _oscillates(row, controller)]
        for controller in controllers
    }
    verdict["software"] = sorted({row["software"] for row in rows if "software" in row})
    bad = [row["phase"] for row in rows if row["phase"] and not row["good"]]
    verdict["bad"] = {
        "all": len(bad),
        "long": sum(phase in LONG_PHASES for phase in bad),
    }
    verdict["astray"] = {
        controller: [
            row["temperature_peak_c"]
            for row in rows
            if row["controller"] == controller and row["phase"] == "downward" and not row["good"]
        ]
        for controller in controllers
    }
    verdict["best"] = _best(rows)
    for controller in controllers:
        own = [row for row in rows if row["controller"] == controller]
        stopped = [row for row in own if "stopped" in row]
        indices = {row["index"] for row in own}
        good = {
            name: len(
                indices - {row["index"] for row in own if row.get("outside_s", np.inf) > at_most_s}
            )
            for name, at_most_s in (("good", AT_MOST_S), ("nearly", _LONGER_S))
        }
        verdict["welds"][controller] = {"welds": len(indices), **good}
        verdict["stopped"][controller] = len(stopped)
        for phase in PHASES:
            of_phase = [row for row in own if row["phase"] == phase]
            if not of_phase:
                continue
            seconds = np.array([row["seconds"] for row in of_phase])
            figures = {
                name: np.array([row[name] for row in of_phase]) for name in (*FIGURES, "power_kw")
            }
            verdict["phases"].setdefault(phase, {})[controller] = {
                "share_good": float(np.mean([row["good"] for row in of_phase])),
                **{
                    name: float(
                        np.mean(values / seconds) if name in _PER_TIME else np.median(values)
                    )
                    for name, values in figures.items()
                },
            }
    return verdict


def _oscillates(row: Row, controller: str) -> bool:
    """Whether the loop oscillates; at the drives' limits the depth is off for another reason."""
    free = row["fastest_s"] <= _LONG_S
    return bool(
        row["controller"] == controller and free and row["depth_sigma_mm"] > _OSCILLATES_MM
    )


def _best(rows: Sequence[Row]) -> dict[str, float]:
    """Share of canisters, welded by all but the slow ``nmpc:paper``, on which each is best.

    By the error of the temperature, RMS over the whole weld.
    """
    errors: dict[int, dict[str, float]] = {}
    for row in rows:
        if row["phase"] and row["controller"] != "nmpc:paper":
            of = errors.setdefault(row["index"], {})
            square = row["temperature_sigma_c"] ** 2 * row["seconds"]
            of[row["controller"]] = of.get(row["controller"], 0.0) + square
    names = {name for of in errors.values() for name in of}
    whole = [of for of in errors.values() if of.keys() == names]
    wins = [min(of, key=lambda name: of[name]) for of in whole]
    return {name: wins.count(name) / len(wins) for name in CONTROLLERS if name in names and wins}


def _saturated(rows: Sequence[Row]) -> dict[int, dict[str, Any]]:
    """Canisters on whose joint line every controller saturates the speed for long; their rows."""
    by_canister: dict[int, dict[str, Any]] = {}
    for row in rows:
        if row["phase"] == "joint_line":
            by_canister.setdefault(row["index"], {})[row["controller"]] = row
    return {
        index: of
        for index, of in sorted(by_canister.items())
        if all(joint_line["fastest_s"] > _LONG_S for joint_line in of.values())
    }


def shares(verdict: Mapping[str, Any]) -> list[list[str]]:
    """Share of welds inside the limits in all phases."""
    names = list(verdict["welds"])
    rows = [["phase", *(f"`{name}`" for name in names)]]
    welds = verdict["welds"].values()
    rows.append(["**all phases**", *(_counted(count["good"], count["welds"]) for count in welds)])
    rows.append(
        [
            f"all, with {_LONGER_S:g} s",
            *(_counted(count["nearly"], count["welds"]) for count in welds),
        ]
    )
    best = verdict["best"]
    rows.append(
        [
            "smallest error of the weld",
            *(f"{100 * best[c]:.0f} %" if c in best else "-" for c in names),
        ]
    )
    return rows


def _counted(good: int, welds: int) -> str:
    """A share as a count, and its Wilson interval of 95 %."""
    if not welds:
        return "-"
    low, high = wilson(good, welds)
    return f"{good} of {welds}, {100 * low:.0f} to {100 * high:.0f} %"


def figures(verdict: Mapping[str, Any], phase: str) -> list[list[str]]:
    """The figures of a phase."""
    names = list(verdict["welds"])
    rows = [[phase.replace("_", " "), *(f"`{label}`" for label in names)]]
    of = verdict["phases"][phase]
    for name, (words, factor, style) in FIGURES.items():
        rows.append(
            [words, *(format(factor * of[c][name], style) if c in of else "-" for c in names)]
        )
    return rows


def best_of(verdict: Mapping[str, Any], name: str, controller: str) -> str:
    """Words for the phases in which a controller has the smallest of a figure."""
    return ", ".join(
        phase.replace("_", " ")
        for phase, of in verdict["phases"].items()
        if controller in of and of[controller][name] == min(other[name] for other in of.values())
    )


def against(
    verdict: Mapping[str, Any], phase: str, name: str, controller: str = CONTROLLERS[0]
) -> str:
    """Ratios of a controller's figure to those of the PI tunings, as text."""
    of = verdict["phases"][phase]
    shares = sorted(
        of[controller][name] / of[rival][name] for rival in PI if rival in of and of[rival][name]
    )
    return (
        " to ".join(f"{100.0 * share:.0f} %" for share in (shares[0], shares[-1]))
        if shares
        else "-"
    )


def beyond(saturated: Mapping[int, Mapping[str, Row]]) -> list[list[str]]:
    """Controllers on the joint line of canisters that need more than the drives give."""
    rows = [
        [
            "canister, controller",
            "at the highest speed [min]",
            "RMS error [°C]",
            "largest error of the depth [mm]",
        ]
    ]
    for index, of in list(saturated.items())[:_SHOWN]:
        for name in (label for label in CONTROLLERS if label in of):
            row = of[name]
            numbers = (row["fastest_s"] / 60.0, row["temperature_sigma_c"], row["depth_peak_mm"])
            rows.append(
                [
                    f"{index}, `{name}`",
                    *(f"{n:.{d}f}" for n, d in zip(numbers, (0, 1, 2), strict=True)),
                ]
            )
    return rows


def identified(estimates: Mapping[str, Any]) -> list[list[str]]:
    """The thermal coefficients with intervals of 95 %, beside the paper's."""
    names = ("gain [°C/kW]", "copper's lag [s]", "tool's lag [s]", "dead time [s]")
    rows = [
        ["`identify` on", *names],
        ["paper (16)", *(f"{getattr(nominal(), name):g}" for name in THERMAL)],
    ]
    for words, estimate in estimates.items():
        rows.append(
            [
                words,
                *(
                    f"{estimate[name][0]:.2f}"
                    + (f" ± {1.96 * estimate[name][1]:.2f}" if estimate[name][1] else "")
                    for name in THERMAL
                ),
            ]
        )
    return rows


def responses(steps: Mapping[str, Mapping[str, float]]) -> list[list[str]]:
    """Step responses at some times."""
    rows = [["rise after 1 kW more [°C]", *(f"{t:g} s" for t in STEP_TIMES_S)]]
    return rows + [
        [name, *(f"{rises_c[f'{t:g}']:.2f}" for t in STEP_TIMES_S)]
        for name, rises_c in steps.items()
    ]


def compacts(models: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Largest error of the reduced model, by number of states and traverse speed."""
    rows = [["states (tolerance)", *(f"{speed} mm/min [°C]" for speed in models[0]["largest_c"])]]
    for model in models:
        words = f"{model['states']} ({model['tolerance_k']:g} K)"
        rows.append([words, *(f"{value:.2f}" for value in model["largest_c"].values())])
    return rows


def coppers(copper: Mapping[str, Any]) -> list[list[str]]:
    """Stir zone with nonlinear copper, and errors of both linear models, at some moments."""
    time_s, phase = np.array(copper["at_s"]), np.array(copper["phase"])
    moments = [
        (f"end of the {name.replace('_', ' ')}", np.flatnonzero(phase == name)[-1])
        for name in ("dwell", "downward")
    ]
    moments += [
        (f"{m:g} min", np.searchsorted(time_s, 60.0 * m))
        for m in _COPPER_MIN
        if 60.0 * m <= time_s[-1]
    ]
    real, *linear = (
        np.array(copper["stir_zone_c"][name]) for name in ("real", "kirchhoff", "constant")
    )
    rows = [["stir zone [°C]", *(words for words, _ in moments)]]
    rows.append(["k(T), c(T), radiation as it is", *(f"{real[at]:.0f}" for _, at in moments)])
    for words, values in zip(
        ("k(T) by the transform, one k/c", "constant k and c"), linear, strict=True
    ):
        rows.append([f"{words}: less that", *(f"{(values - real)[at]:+.1f}" for _, at in moments)])
    return rows


def worst_copper(copper: Mapping[str, Any], model: str, phase: str) -> list[float]:
    """Lowest and highest error of a linear model in a phase."""
    inside = np.array(copper["phase"]) == phase
    wrong = np.subtract(copper["stir_zone_c"][model], copper["stir_zone_c"]["real"])[inside]
    return [float(wrong.min()), float(wrong.max())]


def summary_rows(verdict: Mapping[str, Any]) -> list[list[str]]:
    """Welds inside all limits; errors where heat changes fastest and over most of the weld."""
    rows = shares(verdict)
    for phase in ("downward", "joint_line"):
        named = {row[0]: row[1:] for row in figures(verdict, phase)}
        for name in ("temperature_sigma_c", "moved_rpm"):
            title = FIGURES[name][0]
            rows.append([f"{phase.replace('_', ' ')}: {title}", *named[title]])
    return rows


def verdict_content(verdict: Mapping[str, Any]) -> dict[str, Any]:
    """Content of the page of the verdict: figures, and all tables by name."""
    phases = verdict["phases"]
    long = [of["temperature_sigma_c"] for name in LONG_PHASES for of in phases[name].values()]
    own = CONTROLLERS[0]
    astray = {
        name: {"canisters": len(peaks), "largest_c": round(max(peaks, default=0.0))}
        for name, peaks in verdict["astray"].items()
    }
    best = {name: best_of(verdict, "temperature_sigma_c", name) for name in verdict["welds"]}
    return {
        "welds": {name: of["welds"] for name, of in verdict["welds"].items()},
        "inside_percent": {
            phase: {name: round(100.0 * of[name]["share_good"]) for name in of}
            for phase, of in phases.items()
        },
        "stopped": sum(verdict["stopped"].values()),
        "long_phases_c": round(max(long), 1),
        "power_kw": [round(phases[name][own]["power_kw"]) for name in ("downward", "overlap")],
        "joint_line_shares": {
            name: against(verdict, "joint_line", name)
            for name in ("temperature_sigma_c", "moved_rpm")
        },
        "depth_um": {
            name: round(1e3 * of["depth_sigma_mm"]) for name, of in phases["downward"].items()
        },
        "bad": verdict["bad"],
        "astray": astray,
        "best": best,
        "oscillating": {name: len(of) for name, of in verdict["oscillating"].items()},
        "oscillates_um": round(max(verdict["oscillating"][own], default=0.0)),
        "saturated": len(verdict["saturated"]),
        "software": verdict["software"],
        "tables": {
            "summary": summary_rows(verdict),
            **{
                name.replace("_", " "): figures(verdict, name)
                for name in ("downward", "joint_line")
            },
            "beyond the drives": beyond(verdict["saturated"]),
        },
    }


def plant_content(validation: Mapping[str, Any], copper: Mapping[str, Any]) -> dict[str, Any]:
    """Content of the page of the plant: figures, and all tables by name."""
    gain, lag_s = validation["steps"]["lid"]["lags"]["120"]
    reduced, weld = validation["reduced"], validation["weld"]
    named = ("states", "element_mm", "modes", "largest_c", "rms_c", "fine_states", "from_fine_c")
    return {
        "lid": {"gain_c_per_kw": round(gain, 1), "lag_s": round(lag_s, 1)},
        "reduced": {name: round(reduced[name], 2) for name in named}
        | {"phases_c": _rounded(reduced["phases_c"], 2)},
        "steps_c": {name: _rounded(of["rise_c"], 2) for name, of in validation["steps"].items()},
        "weld": {
            "minutes_kw": [round(mean_kw, 2) for mean_kw in weld["minutes_kw"]],
            "phases_kw": _rounded(weld["phases_kw"], 1),
            "phases_s": weld["phases_s"],
        },
        "copper": {
            "minutes": round(copper["at_s"][-1] / 60.0),
            "power_kw": round(copper["power_kw"]),
            "reference_c": round(copper["reference_c"]),
            **{
                model: [round(error) for error in worst_copper(copper, model, "joint_line")]
                for model in ("kirchhoff", "constant")
            },
        },
        "tables": {
            "number of states": compacts(validation["compact"]),
            "copper as it is": coppers(copper),
            "identification": identified(validation["identified"]),
        },
    }


def _rounded(values: Mapping[str, float], digits: int) -> dict[str, float]:
    return {name: round(value, digits) for name, value in values.items()}


def page(name: str, content: Mapping[str, Any]) -> str:
    """A page of the study."""
    limits = {
        "window": WINDOW_C,
        "depth_mm": DEPTH_MM,
        "temperature_c": TEMPERATURE_C,
        "at_most_s": AT_MOST_S,
        "longer_s": _LONGER_S,
    }
    template = templates(Path(__file__).parent).get_template(f"{name}.md.j2")
    steps = responses(content.get("steps_c", {}))
    text = template.render(content, limits=limits, tolerance_k=TOLERANCE_K, steps=steps)
    return text.rstrip("\n") + "\n"


def write(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the page of the plant if it was validated, and of the verdict if there are welds.

    Each with its figure and its tables.
    """
    contents: dict[str, tuple[dict[str, Any], Any]] = {}
    if data["validation"]:
        contents["canister"] = plant_content(data["validation"], data["properties"]), draw
    if data["verdict"]["phases"]:
        contents["canister-verdict"] = verdict_content(data["verdict"]), draw_shares
    written = []
    for name, (content, picture) in contents.items():
        texts = {f"{name}.md": page(name, content), f"{name}_tables.json": numbers(content)}
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
        picture(content, folder / f"{name}.png")
        written += [folder / f"{name}.md", folder / f"{name}.png"]
    return written
