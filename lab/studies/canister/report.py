"""The results as a page: rows of the tables, and what the page shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from canister.figures import draw
from canister.validation import STEP_TIMES_S, THERMAL
from fsw_analysis.report import numbers, templates
from fsw_heat.compaction import TOLERANCE_K
from fsw_model import nominal

#: minutes of the weld in the table of the copper's properties
_COPPER_MIN = (5.0, 10.0, 20.0, 40.0)


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


def content_of(validation: Mapping[str, Any], copper: Mapping[str, Any]) -> dict[str, Any]:
    """Content of the page: figures, and all tables by name."""
    gain, lag_s = validation["steps"]["lid"]["lag"]
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


def page(content: Mapping[str, Any]) -> str:
    """The page of the study."""
    template = templates(Path(__file__).parent).get_template("canister.md.j2")
    steps = responses(content["steps_c"])
    return template.render(content, tolerance_k=TOLERANCE_K, steps=steps).rstrip("\n") + "\n"


def write(content: Mapping[str, Any], folder: Path) -> Path:
    """Write the page, its figure and its tables; returns the page."""
    file = folder / "canister.md"
    file.write_text(page(content), encoding="utf-8")
    (folder / "canister_tables.json").write_text(numbers(content), encoding="utf-8")
    draw(content, folder / "canister.png")
    return file
