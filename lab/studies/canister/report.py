"""The results as a page and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from canister.validation import STEP_TIMES_S, THERMAL
from canister.verdict import AT_MOST_S, DEPTH_MM, TEMPERATURE_C, WINDOW_C, Row
from fsw_analysis.figure_style import COLOURS, colours_of, shade_phases, sheet
from fsw_analysis.report import templates, wilson
from fsw_heat.compaction import TOLERANCE_K
from fsw_model import nominal

PI = ("decentral:conservative", "decentral:tight")
CONTROLLERS = ("nmpc:default", "nmpc:adaptive", "nmpc:paper", *PI, "decentral:smith")
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
#: of the joint line at a drive's limit: a canister that asks for more than the drive gives
_LONG_S = 60.0
#: error of the depth over the joint line, RMS, of a loop that oscillates for good; the others have
#: a few µm (chosen)
_OSCILLATES_MM = 0.02
#: error of the depth on the way down, RMS, up to which depth and temperature count as decoupled
#: (chosen)
_DECOUPLED_MM = 0.005
#: the milder limit on the time outside, that of the campaign for the temperature
_LONGER_S = 30.0
#: shortest phase whose name has room in the figure
_NAMED_S = 50.0
#: minutes of the weld in the table of the copper's properties
_COPPER_MIN = (5.0, 10.0, 20.0, 40.0)
_SMALL: dict[str, Any] = {"fontsize": 7.0, "color": "dimgray"}
#: in the figure of the steps, what is no canister
_LINES: dict[str, dict[str, Any]] = {
    "paper (16)": {"color": "black", "linestyle": "--"},
    "line source in a plate, no edge": {"color": "grey", "linestyle": ":"},
    "line source in a plate, edge at 60 mm": {"color": "grey", "linestyle": "-."},
}
#: rows of the table of canisters that no controller can weld within the limits
_SHOWN = 4
#: figures that are for the length of a phase; of these the mean is shown, of the others the median
_PER_TIME = ("moved_kn", "moved_rpm", "fastest_s")


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Of rows of welds: how many, and by phase and controller the share inside the limits and the figures.

    Controllers that have welded nothing are left out.
    """
    controllers = [one for one in CONTROLLERS if any(row["controller"] == one for row in rows)]
    found: dict[str, Any] = {
        "welds": {},
        "stopped": {},
        "phases": {},
        "saturated": _saturated(rows),
    }
    line = [row for row in rows if row["phase"] == "joint_line"]
    found["oscillating"] = {
        controller: [1e3 * row["depth_sigma_mm"] for row in line if _oscillates(row, controller)]
        for controller in controllers
    }
    found["software"] = sorted({row["software"] for row in rows if "software" in row})
    bad = [row["phase"] for row in rows if row["phase"] and not row["good"]]
    found["bad"] = {
        "all": len(bad),
        "long": sum(phase in ("joint_line", "overlap") for phase in bad),
    }
    found["astray"] = {
        controller: [
            row["temperature_peak_c"]
            for row in rows
            if row["controller"] == controller and row["phase"] == "downward" and not row["good"]
        ]
        for controller in controllers
    }
    found["best"] = _best(rows)
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
        found["welds"][controller] = {"welds": len(indices), **good}
        found["stopped"][controller] = len(stopped)
        for phase in PHASES:
            of_phase = [row for row in own if row["phase"] == phase]
            if not of_phase:
                continue
            seconds = np.array([row["seconds"] for row in of_phase])
            figures = {
                name: np.array([row[name] for row in of_phase]) for name in (*FIGURES, "power_kw")
            }
            found["phases"].setdefault(phase, {})[controller] = {
                "share_good": float(np.mean([row["good"] for row in of_phase])),
                **{
                    name: float(
                        np.mean(values / seconds) if name in _PER_TIME else np.median(values)
                    )
                    for name, values in figures.items()
                },
            }
    return found


def _oscillates(row: Row, controller: str) -> bool:
    """Whether the loop oscillates; where the drives are at their limit, the depth is off for another reason."""
    free = row["fastest_s"] <= _LONG_S
    return bool(
        row["controller"] == controller and free and row["depth_sigma_mm"] > _OSCILLATES_MM
    )


def _best(rows: Sequence[Row]) -> dict[str, float]:
    """Of the canisters that all but the slow ``nmpc:paper`` have welded, on how many each is best.

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
    """Canisters on whose joint line every controller is at the highest speed for long, and what each does there."""
    found: dict[int, dict[str, Any]] = {}
    for row in rows:
        if row["phase"] == "joint_line":
            found.setdefault(row["index"], {})[row["controller"]] = row
    return {
        index: of
        for index, of in sorted(found.items())
        if all(one["fastest_s"] > _LONG_S for one in of.values())
    }


def shares(verdict: Mapping[str, Any]) -> list[list[str]]:
    """Share of welds inside the limits, by phase and for the whole weld."""
    names = list(verdict["welds"])
    rows = [["phase", *(f"`{one}`" for one in names)]]
    for phase, of in verdict["phases"].items():
        rows.append(
            [phase, *(f"{100 * of[c]['share_good']:.0f} %" if c in of else "-" for c in names)]
        )
    welds = verdict["welds"].values()
    rows.append(["**all phases**", *(_counted(one["good"], one["welds"]) for one in welds)])
    rows.append(
        [f"all, with {_LONGER_S:g} s", *(_counted(one["nearly"], one["welds"]) for one in welds)]
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
    rows = [[phase.replace("_", " "), *(f"`{one}`" for one in names)]]
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
        if controller in of and of[controller][name] == min(one[name] for one in of.values())
    )


def decoupled(verdict: Mapping[str, Any]) -> dict[str, str]:
    """Who keeps the depth on the way down, where heat changes fastest, and who does not: names with errors."""
    words: dict[str, list[str]] = {"yes": [], "no": []}
    for name, of in verdict["phases"]["downward"].items():
        kept = "yes" if of["depth_sigma_mm"] <= _DECOUPLED_MM else "no"
        words[kept].append(f"{1e3 * of['depth_sigma_mm']:.0f} µm with `{name}`")
    return {kept: ", ".join(one) for kept, one in words.items()}


def against(
    verdict: Mapping[str, Any], phase: str, name: str, controller: str = CONTROLLERS[0]
) -> str:
    """A figure of a controller as shares of those of the PI tunings, in words."""
    of = verdict["phases"][phase]
    shares = sorted(
        of[controller][name] / of[one][name] for one in PI if one in of and of[one][name]
    )
    return (
        " to ".join(f"{100.0 * share:.0f} %" for share in (shares[0], shares[-1]))
        if shares
        else "-"
    )


def beyond(saturated: Mapping[int, Mapping[str, Row]]) -> list[list[str]]:
    """What the controllers do on the joint line of canisters that ask for more than the drives give."""
    rows = [
        [
            "canister, controller",
            "at the highest speed [min]",
            "RMS error [°C]",
            "largest error of the depth [mm]",
        ]
    ]
    for index, of in list(saturated.items())[:_SHOWN]:
        for name in (one for one in CONTROLLERS if one in of):
            row = of[name]
            numbers = (row["fastest_s"] / 60.0, row["temperature_sigma_c"], row["depth_peak_mm"])
            rows.append(
                [
                    f"{index}, `{name}`",
                    *(f"{n:.{d}f}" for n, d in zip(numbers, (0, 1, 2), strict=True)),
                ]
            )
    return rows


def identified(found: Mapping[str, Any]) -> list[list[str]]:
    """The thermal coefficients with intervals of 95 %, beside the paper's."""
    names = ("gain [°C/kW]", "copper's lag [s]", "tool's lag [s]", "dead time [s]")
    rows = [
        ["`identify` on", *names],
        ["paper (16)", *(f"{getattr(nominal(), name):g}" for name in THERMAL)],
    ]
    for words, of in found.items():
        rows.append(
            [
                words,
                *(
                    f"{of[name][0]:.2f}" + (f" ± {1.96 * of[name][1]:.2f}" if of[name][1] else "")
                    for name in THERMAL
                ),
            ]
        )
    return rows


def responses(found: Mapping[str, Any]) -> list[list[str]]:
    """Step responses at some times."""
    rows = [["rise after 1 kW more [°C]", *(f"{t:g} s" for t in STEP_TIMES_S)]]
    return rows + [
        [name, *(f"{of['rise_c'][f'{t:g}']:.2f}" for t in STEP_TIMES_S)]
        for name, of in found.items()
    ]


def compacts(found: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Largest difference of the plant's model from the decoupled one, by number of states and traverse speed."""
    rows = [["states (tolerance)", *(f"{speed} mm/min [°C]" for speed in found[0]["largest_c"])]]
    for one in found:
        words = f"{one['states']} ({one['tolerance_k']:g} K)"
        rows.append([words, *(f"{value:.2f}" for value in one["largest_c"].values())])
    return rows


def coppers(found: Mapping[str, Any]) -> list[list[str]]:
    """The stir zone with copper as it is, and what the two linear models are off by, at some moments."""
    time_s, phase = np.array(found["at_s"]), np.array(found["phase"])
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
        np.array(found["stir_zone_c"][name]) for name in ("real", "kirchhoff", "constant")
    )
    rows = [["stir zone [°C]", *(words for words, _ in moments)]]
    rows.append(["k(T), c(T), radiation as it is", *(f"{real[at]:.0f}" for _, at in moments)])
    for words, values in zip(
        ("k(T) by the transform, one k/c", "constant k and c"), linear, strict=True
    ):
        rows.append([f"{words}: less that", *(f"{(values - real)[at]:+.1f}" for _, at in moments)])
    return rows


def worst_copper(found: Mapping[str, Any], model: str, phase: str) -> list[float]:
    """Lowest and highest error of a linear model in a phase."""
    inside = np.array(found["phase"]) == phase
    wrong = np.subtract(found["stir_zone_c"][model], found["stir_zone_c"]["real"])[inside]
    return [float(wrong.min()), float(wrong.max())]


def differences(reduced: Mapping[str, Any]) -> list[list[str]]:
    """Largest difference of the reduced model by phase."""
    phases = reduced["phases_c"]
    header = ["largest difference [°C]", *(name.replace("_", " ") for name in phases)]
    return [header, ["stir zone", *(f"{value:.2f}" for value in phases.values())]]


def powers(weld: Mapping[str, Any]) -> list[list[str]]:
    """Mean power of each phase."""
    phases = weld["phases_kw"]
    header = ["needed power [kW]", *(name.replace("_", " ") for name in phases)]
    return [header, ["mean", *(f"{value:.1f}" for value in phases.values())]]


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


def _draw_steps(axis: Any, steps: Mapping[str, Any]) -> None:
    names = [name for name in steps if name not in _LINES]
    styles = {
        name: {"color": colour, "marker": "o"}
        for name, colour in zip(names, COLOURS, strict=False)
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
    axis.legend(fontsize=8)


def _draw_shares(axis: Any, verdict: Mapping[str, Any]) -> None:
    phases, names = verdict["phases"], tuple(verdict["welds"])
    width = 0.8 / len(names)
    for i, (controller, colour) in enumerate(zip(names, colours_of(names), strict=True)):
        shares = [
            100.0 * of[controller]["share_good"] if controller in of else np.nan
            for of in phases.values()
        ]
        places = np.arange(len(phases)) + (i - 0.5 * (len(names) - 1)) * width
        axis.bar(places, shares, 0.9 * width, label=controller, color=colour)
        for place, share in zip(places, shares, strict=True):
            if np.isfinite(share):
                axis.annotate(f"{share:.0f}", (place, share), ha="center", va="bottom", **_SMALL)
    axis.set_xticks(range(len(phases)), [phase.replace("_", " ") for phase in phases])
    axis.set(
        ylabel="%", ylim=(0.0, 112.0), yticks=range(0, 101, 20), title="welds inside the limits"
    )
    axis.grid(axis="x", visible=False)
    axis.legend(fontsize=8, ncols=len(names), loc="upper center", bbox_to_anchor=(0.5, -0.12))


def write(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """The page of the plant where it was validated, and that of the verdict where canisters were welded.

    Each with its figure.
    """
    pages = templates(Path(__file__).parent)
    pages.globals |= globals()  # the functions above make the rows of tables
    limits = {
        "window": WINDOW_C,
        "depth_mm": DEPTH_MM,
        "temperature_c": TEMPERATURE_C,
        "at_most_s": AT_MOST_S,
    }
    pictures = {
        **({"canister": draw} if data["validation"] else {}),
        **({"canister-verdict": draw_shares} if data["verdict"]["phases"] else {}),
    }
    written = []
    for name, picture in pictures.items():
        text = pages.get_template(f"{name}.md.j2").render(
            **data, limits=limits, tolerance_k=TOLERANCE_K
        )
        page, figure = folder / f"{name}.md", folder / f"{name}.png"
        page.write_text(text.rstrip("\n") + "\n", encoding="utf-8")
        picture(data, figure)
        written += [page, figure]
    return written
