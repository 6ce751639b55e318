"""The results of the comparison as pages, one per question: rows of their tables, for the templates ``*.md.j2``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from controller_comparison.study import (
    CONTROLLERS,
    FINALISTS,
    KPIS,
    MATCHED,
    TOLERANCE,
    VARIATIONS,
    ratios,
)
from fsw_analysis.report import templates
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
    "README": "nominal",
    "other-processes": "sweep",
    "other-models": "other_models",
    "losses": "wins",
    "corridors": "corridors",
    "sensors": "sensing",
}
#: depth and temperature apart
_EVENTS = ("z up", "z down", "T up", "T down", "dz", "dT")


def _iae(found: Mapping[str, Any], event: str) -> str:
    """The figure that an event is about."""
    key = "iae_depth_mm_s" if EVENTS[event].of_depth else "iae_temperature_c_s"
    return f"{found[event][key]:.3g}"


def errors(nominal: Mapping[str, Any], kind: str, bounds: Mapping[str, Any] | None = None) -> Rows:
    """IAE of each event."""
    rows = [["IAE", *(f"{e} [{'mm s' if EVENTS[e].of_depth else '°C s'}]" for e in _EVENTS)]]
    rows += [
        [label, *(_iae(nominal[label][kind]["events"], event) for event in _EVENTS)]
        for label in CONTROLLERS
    ]
    if bounds:
        joint = {e: bounds[e]["joint"][0 if EVENTS[e].of_depth else 1] for e in _EVENTS}
        rows.append(["clairvoyant, both outputs", *(f"{joint[e]:.3g}" for e in _EVENTS)])
        rows.append(
            ["clairvoyant, that output alone", *(f"{bounds[e]['alone']:.3g}" for e in _EVENTS)]
        )
    return rows


def other_output(nominal: Mapping[str, Any], kind: str) -> Rows:
    """The largest error that each event leaves in the other output."""

    def peak(event: Mapping[str, float], of_depth: bool) -> str:
        peak_c, peak_um = event["peak_temperature_error_c"], 1e3 * event["peak_depth_error_mm"]
        return f"{peak_c:.3g} °C" if of_depth else f"{peak_um:.3g} µm"

    found = {label: nominal[label][kind]["events"] for label in CONTROLLERS}
    rows = [
        [label, *(peak(events[e], EVENTS[e].of_depth) for e in _EVENTS)]
        for label, events in found.items()
    ]
    return [["peak of the other output", *_EVENTS], *rows]


def totals(nominal: Mapping[str, Any]) -> Rows:
    """Whole cases, without noise, and movement at rest with noise."""
    header = [
        "",
        "tracking z / T",
        "disturbances z / T",
        "noisy tracking z / T",
        "noisy disturbances z / T",
    ]
    rows = [[*header, "force at rest [kN/s]", "speed at rest [rpm/s]"]]
    for label in CONTROLLERS:
        runs = [nominal[label][kind][case] for kind in ("clean", "noisy") for case in CASES]
        cells = [f"{run['iae_depth_mm_s']:.3g} / {run['iae_temperature_c_s']:.3g}" for run in runs]
        rows.append([label, *cells, *(f"{nominal[label]['rest'][key]:.2g}" for key in VARIATIONS)])
    return rows


def _judged(runs: Mapping[str, Any]) -> list[str]:
    return [
        " / ".join(f"{runs[label][key]:.3g}" for label in FINALISTS if label in runs)
        for key in JUDGED
    ]


def sweep_rows(data: Mapping[str, Any]) -> Rows:
    """IAE on processes that differ from the model, and whether an output oscillates for good."""
    rows = [["plant", *JUDGED.values(), "oscillates for good"]]
    for name, runs in data.items():
        if not failed(runs):
            swinging = ", ".join(label for label, run in runs.items() if run["swings"])
            rows.append([name, *_judged(runs), swinging or "–"])
    return rows


def model_rows(data: Mapping[str, Any]) -> Rows:
    """IAE on other models."""
    return [["model", *JUDGED.values()], *([name, *_judged(runs)] for name, runs in data.items())]


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
    for label, found in data.items():
        words = texts(found)
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


def small_rows(data: Mapping[str, Mapping[str, float]]) -> Rows:
    """Mean absolute errors with disturbances below the noise, and at rest."""
    heads = {"iae_depth_mm_s": "depth [µm]", "iae_temperature_c_s": "temperature [m°C]"}
    cases = {"disturbed": "disturbed", "rest": "at rest"}
    rows = [
        [
            "mean absolute error",
            *(f"{head}, {case}" for head in heads.values() for case in cases.values()),
        ]
    ]
    for label, of in data.items():
        rows.append([label, *(f"{of[f'{case} {key}']:.3g}" for key in heads for case in cases)])
    return rows


def sensing_rows(data: Mapping[str, Mapping[str, Any]], keys: tuple[str, str]) -> Rows:
    """Two figures of every controller with every kind of sensors."""
    names = list(next(iter(data.values())))
    return [
        ["", *data],
        *([name, *(_pair(of[name], keys) for of in data.values())] for name in names),
    ]


def _pair(of: Mapping[str, float], keys: tuple[str, str]) -> str:
    return " / ".join(f"{of[key]:.3g}" for key in keys)


def swinging(data: Mapping[str, Mapping[str, Any]], welds: int) -> list[str]:
    """With which sensors an output oscillates for good, in how many of the welds of a controller."""
    found = []
    for kind, of in data.items():
        if names := [
            f"{name} ({run['swings']} of {welds} welds)"
            for name, run in of.items()
            if run["swings"]
        ]:
            found.append(f"{kind}: {', '.join(names)}")
    return found


def lag_rows(data: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Rows:
    """Gain and delay margin of the temperature by lag of the probe."""
    rows = [["gain margin, delay margin", *data]]
    for name in next(iter(data.values())):
        rows.append([name, *(", ".join(texts(of[name]).values()) for of in data.values())])
    return rows


def matched_share(data: Mapping[str, Mapping[str, float]], rival: str) -> str:
    """Smallest and largest error of the matched NMPC as shares of a rival's, in words."""
    shares = [100.0 * data[MATCHED][key] / data[rival][key] for key in JUDGED]
    return f"{min(shares):.0f} to {max(shares):.0f} %"


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


def knob_rows(data: Mapping[str, Mapping[str, float]]) -> Rows:
    """Gain margin against errors of the temperature."""
    rows = [
        [
            "temperature_aggressiveness",
            "temperature: gain",
            *(f"{case}, IAE T [°C s]" for case in CASES),
        ]
    ]
    for value, found in data.items():
        rows.append(
            [value, f"{found['temperature_gain']:.2f}", *(f"{found[case]:.3g}" for case in CASES)]
        )
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


def random_rows(data: Mapping[str, Sequence[float]], rival: str = "the better PI") -> Rows:
    """Distribution of the ratio to a rival."""
    rows = [[f"default NMPC over {rival}", "median", "95 %", "largest", "plants at or below 1"]]
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
    for title, found in sorted(by_kpi.items(), key=lambda item: -len(item[1])):
        name, case, noise, _, largest = found[0]
        where = f"{case}{', noise' if noise else ''}, plant {name}"
        rows.append(
            [title, str(len(found)), f"{found[len(found) // 2][-1]:.2f}", f"{largest:.2f}", where]
        )
    return rows


def pages(data: Mapping[str, Any]) -> dict[str, str]:
    """All results as Markdown: the text of each page by file name, without the pages of parts that were not run."""
    environment = templates(Path(__file__).parent)
    environment.globals |= globals()  # the functions above make the rows of tables
    environment.globals |= {
        "set_points": SET_POINTS,
        "disturbances": DISTURBANCES,
        "judged": JUDGED,
        "kpis": KPIS,
    }
    environment.globals |= {"default": DEFAULT, "matched_label": MATCHED, "ratios": ratios}
    parts = {
        **dict.fromkeys(
            (
                "below_noise",
                "bounds",
                "corridors",
                "margins",
                "matched",
                "other_models",
                "random",
                "sensing",
                "wins",
            )
        ),
        **data,
    }
    return {
        f"{name}.md": environment.get_template(f"{name}.md.j2").render(parts)
        for name, part in PAGES.items()
        if part in data
    }
