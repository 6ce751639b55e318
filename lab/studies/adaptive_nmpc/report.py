"""The page and the figure of the study."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from adaptive_nmpc.search import JUDGED_BY, STEADY_C, is_steady
from adaptive_nmpc.search import ratio as harm
from adaptive_nmpc.study import (
    ADAPTIVE,
    COLUMNS,
    FIXED,
    NOISE_SEEDS,
    NOISY_PLANTS,
    RIVALS,
    SEED,
    ran,
)
from controller_comparison.report import margin_rows
from controller_comparison.study import KPIS, TOLERANCE, VARIATIONS
from fsw_analysis.figure_style import label_time, legend_below, looks_of, sheet
from fsw_analysis.kpi_table import ROWS
from fsw_analysis.report import templates
from fsw_analysis.weld_signals import WeldSignals
from fsw_model import nominal as nominal_parameters
from fsw_tuning.standard_cases import CASES, EVENTS, SMITH, TIGHT
from fsw_tuning.standard_runs import JUDGED, Figures

#: Largest tolerated ratio of a figure with to without adaptation.
TOLERATED = 1.1
#: A difference of two runs is beyond noise if it is more than so many of its standard deviations.
BEYOND_NOISE = 2.0
#: Figures of a late response, by their titles.
LATE = {"largest error [°C]": "peak_c", "still moving [°C]": "moves_c"}
#: Figures of the search and the cases from which the larger ratio is taken, by their titles.
SEARCHED = {
    "temperature, set-points": (JUDGED_BY, ["tracking"]),
    "temperature, disturbances": (JUDGED_BY, ["disturbances"]),
    "depth": ("iae_depth_mm_s", list(CASES)),
}
Plants = Sequence[Mapping[str, Figures]]
Rows = list[list[str]]


_TITLES = {"tracking": "set-points", "disturbances": "disturbances"}


def figures(plants: Plants) -> dict[str, str]:
    """All figures of merit of both cases, by key, with their titles."""
    keys = (f"{case} {key}" for case in CASES for key in KPIS)
    known = plants[0][ADAPTIVE]
    return {
        key: f"{_TITLES[key.split()[0]]}, {KPIS[key.split()[1]]}" for key in keys if key in known
    }


def ratio(
    plants: Plants, own: str, rivals: Sequence[str], key: str
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A figure of one column over the best rival's, on every plant."""
    return np.array(
        [runs[own][key] / min(runs[rival][key] for rival in rivals) for runs in plants]
    )


def shares(plants: Plants, rivals: Sequence[str]) -> Rows:
    """Share of plants on which a column is at or below the best rival."""
    rows = [["", *JUDGED.values()]]
    for own in (column for column in COLUMNS if column.startswith("nmpc")):
        rows.append(
            [
                own,
                *(
                    f"{100.0 * (ratio(plants, own, rivals, key) <= 1.0).mean():.0f} %"
                    for key in JUDGED
                ),
            ]
        )
    return rows


def won(
    plants: Plants, own: str, rivals: Sequence[str], key: str
) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Plants on which a figure is at or below the best rival's (movement: the tight PI's)."""
    if rivals == RIVALS and key.split()[1] in VARIATIONS:
        rivals = (TIGHT,)
    return ratio(plants, own, rivals, key) <= 1.0 + TOLERANCE


def all_figures(plants: Plants) -> Rows:
    """Share of plants on which the adaptive controller wins each figure; for each NMPC, of all."""
    rivals = {TIGHT: (TIGHT,), "both PIs": RIVALS, SMITH: (SMITH,)}
    rows = [["", *rivals]]
    for key, title in figures(plants).items():
        shares = [100.0 * won(plants, ADAPTIVE, some, key).mean() for some in rivals.values()]
        rows.append([title, *(f"{share:.0f} %" for share in shares)])
    for own in (column for column in COLUMNS if column.startswith("nmpc")):
        shares = [
            100.0 * np.mean([won(plants, own, r, k) for k in figures(plants)])
            for r in rivals.values()
        ]
        rows.append([f"**all figures, {own}**", *(f"**{share:.1f} %**" for share in shares)])
    return rows


def scatter(noise: Sequence[Sequence[Figures]], key: str) -> float:
    """Relative standard deviation of a figure over seeds of the noise: RMS over the plants."""
    values = np.array([[run[key] for run in runs] for runs in noise])
    return float(np.sqrt(np.mean((values.std(axis=1, ddof=1) / values.mean(axis=1)) ** 2)))


def by_chance(noise: Sequence[Sequence[Figures]], keys: Collection[str]) -> float:
    """Share of figures that another seed of the noise alone makes worse than tolerated."""
    values = np.array([[[run[key] for key in keys] for run in runs] for runs in noise])
    over = values[:, :, None] / values[:, None]
    n = values.shape[1]
    return float(
        (over > TOLERATED).sum() / (over.size * (n - 1) / n)
    )  # a seed against itself is none


def lost(plants: Plants, rival: str, key: str, sigma: float = 0.0) -> int:
    """Number of plants on which a figure is worse than tolerated, and by more than its noise.

    ``sigma`` is the figure's standard deviation over seeds of the sensor noise, as a share of it:
    both runs have it.
    """
    r = ratio(plants, ADAPTIVE, [rival], key)
    return int((r > max(TOLERATED, 1.0 + BEYOND_NOISE * 2.0**0.5 * sigma)).sum())


def against(plants: Plants, rival: str, noise: Mapping[str, float] | None = None) -> Rows:
    """Ratios of the adaptive controller's figures to another's, over the plants."""
    rows = [["figure", "median", "95 %", "worst", "there", f"worse than × {TOLERATED:g}"]]
    if noise:
        rows[0] += ["noise, σ", "and beyond it"]
    for key, title in figures(plants).items():
        r = ratio(plants, ADAPTIVE, [rival], key)
        numbers = (f"{value:.2f}" for value in (np.median(r), np.percentile(r, 95.0), r.max()))
        runs = plants[int(r.argmax())]
        factor = ROWS[key.split()[1]][2]  # to the unit of the title
        there = f"{factor * runs[rival][key]:.3g} → {factor * runs[ADAPTIVE][key]:.3g}"
        rows.append([title, *numbers, there, f"{lost(plants, rival, key)} of {len(r)}"])
        if noise:
            rows[-1] += [f"{100.0 * noise[key]:.1f} %", f"{lost(plants, rival, key, noise[key])}"]
    return rows


def drift_rows(data: Mapping[str, Mapping[str, Sequence[float]]]) -> Rows:
    """Ramp, sine and jumps of the tool without and with noise; movement of the force at rest."""
    header = ["without / with noise", "ramp, IAE [mm s]", "sine, IAE [mm s]"]
    rows = [
        [*header, "tool deeper, peak [°C]", "tool shallower, peak [°C]", "force at rest [kN/s]"]
    ]
    for label, errors in data.items():
        pairs = (
            " / ".join(f"{value:.3f}" for value in errors[name])
            for name in ("ramp", "sine", "deeper", "shallower")
        )
        rows.append([label, *pairs, f"{errors['rest'][0]:.3f}"])
    return rows


def events(nominal: Mapping[str, Mapping[str, Any]]) -> Rows:
    """IAE of each event and the largest error of the temperature in it, on the model's own process."""
    rows = [["event", *(f"{label}: {what}" for what in ("IAE", "peak °C") for label in nominal)]]
    for name, step in EVENTS.items():
        key = "iae_depth_mm_s" if step.of_depth else "iae_temperature_c_s"
        errors = [f"{runs['events'][name][key]:.3g}" for runs in nominal.values()]
        peaks = [
            f"{runs['events'][name]['peak_temperature_error_c']:.2f}" for runs in nominal.values()
        ]
        rows.append([f"{step.size}{' (disturbance)' if name[0] == 'd' else ''}", *errors, *peaks])
    return rows


def at_rest(nominal: Mapping[str, Mapping[str, Any]]) -> Rows:
    """Movement per second caused by noise."""
    rows = [["at rest, with noise", "force [kN/s]", "speed [rpm/s]"]]
    return rows + [
        [label, *(f"{runs['rest'][key]:.3g}" for key in VARIATIONS)]
        for label, runs in nominal.items()
    ]


def saturation(data: Mapping[str, Mapping[str, float]]) -> Rows:
    """Errors where the speed is at its bound."""
    rows = [
        ["", "IAE depth [mm s]", "IAE temperature [°C s]", "peak of the temperature's error [°C]"]
    ]
    return rows + [
        [name, *(f"{value:.3g}" for value in errors.values())] for name, errors in data.items()
    ]


def late_rows(data: Sequence[Mapping[str, Any]]) -> Rows:
    """Worst case over gain and lag, by dead time, where the fixed tuning does not oscillate."""
    rows = [
        [
            "dead time beyond the model's [s]",
            "processes",
            *(f"{what}, {c}" for what in LATE for c in (FIXED, ADAPTIVE)),
        ]
    ]
    rows[0].append(f"IAE worse than × {TOLERATED:g}")
    for later_s in dict.fromkeys(row["later_s"] for row in data):
        kept = [
            row for row in data if row["later_s"] == later_s and row[FIXED]["peak_c"] < STEADY_C
        ]
        worst = (
            max(row[c][key] for row in kept) for key in LATE.values() for c in (FIXED, ADAPTIVE)
        )
        worse = sum(row[ADAPTIVE]["iae_c_s"] > TOLERATED * row[FIXED]["iae_c_s"] for row in kept)
        processes = sum(row["later_s"] == later_s for row in data)
        rows.append(
            [
                f"{later_s:g}",
                f"{len(kept)} of {processes}",
                *(f"{value:.1f}" for value in worst),
                f"{worse}",
            ]
        )
    return rows


def found_rows(rounds: Sequence[Sequence[Mapping[str, Any]]]) -> Rows:
    """Ratios of the IAE with to without adaptation, by round of the search."""
    rows = [["", "plants", *SEARCHED]]
    for number, plants in enumerate(rounds):
        kept = [row for row in plants if is_steady(row)]
        rows.append(["near the worst" if number else "random", f"{len(kept)} of {len(plants)}"])
        for key, cases in SEARCHED.values():
            ratios = np.array([harm(row, key, cases) for row in kept] or [np.nan])
            rows[-1].append(
                f"{np.median(ratios):.2f}/{ratios.max():.2f}/{(ratios > TOLERATED).sum()}"
            )
    return rows


def worst_plant(rounds: Sequence[Sequence[Mapping[str, Any]]]) -> dict[str, float]:
    """Parameters of the plant with the largest ratio of the temperature's IAE in the search."""
    kept = [row for plants in rounds for row in plants if is_steady(row)]
    row = max(kept, key=lambda candidate: harm(candidate, JUDGED_BY))
    dead_s = nominal_parameters().dead_time_s
    plant = row["plant"]
    return {
        "ratio": harm(row, JUDGED_BY),
        "later_s": (plant["factors.dead_time_s"] - 1.0) * dead_s,
        "probe_s": plant["sensors.temperature_lag_s"],
        "gain": plant["factors.thermal_gain_c_per_kw"],
        "lag": plant["factors.copper_lag_s"],
    }


def content(data: Mapping[str, Any]) -> dict[str, Any]:
    """Content of the page, from the numbers of a run: figures, and all tables by name."""
    plants = ran(data["random"])
    noise = {key: scatter(data["noise"], key) for key in figures(plants)}
    late = [(row[ADAPTIVE]["iae_c_s"], row[FIXED]["iae_c_s"]) for row in data["late"]]
    inside, welds = data["inside"]
    lost_figures = sum(lost(plants, FIXED, key) for key in noise)
    return {
        "plants": len(plants),
        "compared": len(plants) * len(noise),
        "lost": lost_figures,
        "lost_percent": round(100.0 * lost_figures / (len(plants) * len(noise)), 1),
        "lost_beyond_noise": sum(lost(plants, FIXED, key, noise[key]) for key in noise),
        "lost_by_chance_percent": round(100.0 * by_chance(data["noise"], noise), 1),
        "campaign": {"welds": welds, "inside_percent": round(100.0 * inside / welds, 1)},
        "swings": {
            column: sum(bool(runs[column].get("swings")) for runs in plants) for column in COLUMNS
        },
        "late": {
            "processes": len(late),
            "worse": sum(own > TOLERATED * fixed for own, fixed in late),
        },
        "worst": {name: round(value, 2) for name, value in worst_plant(data["search"]).items()},
        "tables": {
            "random plants, at or below decentral:tight": shares(plants, [TIGHT]),
            "random plants, all figures": all_figures(plants),
            "random plants, over no adaptation": against(plants, FIXED, noise),
            "dead times": late_rows(data["late"]),
            "search for harm": found_rows(data["search"]),
            "speed at its bound": saturation(data["saturated"]),
            "ramps, sines and jumps": drift_rows(data["drifts"]),
            "margins": margin_rows(data["margins"]),
            "model's own process": events(data["nominal"]),
            "at rest": at_rest(data["nominal"]),
        },
    }


def page(content: Mapping[str, Any]) -> str:
    """The page of the study."""
    return (
        templates(Path(__file__).parent)
        .get_template("adaptive.md.j2")
        .render(
            content,
            seed=SEED,
            adaptive=ADAPTIVE,
            tolerated=TOLERATED,
            noise_runs={"plants": NOISY_PLANTS, "seeds": len(NOISE_SEEDS)},
        )
    )


def draw(welds: Mapping[str, WeldSignals], path: Path) -> None:
    """Depth, temperature and speed where the speed is at its bound."""
    with sheet(9.0, 7.0, path) as canvas:
        axes = canvas.subplots(3, 1, sharex=True)
        for (name, signals), look in zip(welds.items(), looks_of(list(welds)), strict=True):
            truth = signals.truth
            assert truth is not None  # a simulation has it
            time_s = 0.1 * np.arange(len(truth.depth_mm))
            for axis, values in zip(
                axes, (truth.depth_mm, truth.temperature_c, truth.speed_rpm), strict=True
            ):
                axis.plot(time_s, values, **look.line, label=name)
        for axis, title in zip(
            axes, ("depth [mm]", "temperature [°C]", "speed [rpm]"), strict=True
        ):
            axis.set_ylabel(title)
        label_time(axes[2], time_s[-1])
        legend_below(canvas)
        canvas.suptitle(
            "Torque × 0.85, depth 0.2 mm down at 10 s: the speed is at its bound", fontsize=11.0
        )
