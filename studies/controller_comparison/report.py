"""The results of the comparison as a page of text and tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from controller_comparison.study import FINALISTS, quantiles, ratios
from fsw_scenario.standard_cases import CONSERVATIVE, CONTROLLERS, DECENTRALIZED, DEFAULT
from fsw_scenario.standard_events import CASES, DISTURBANCES, EVENTS, SET_POINTS
from fsw_scenario.standard_runs import JUDGED, KPIS, VARIATIONS, failed

_EVENTS = ("z up", "z down", "T up", "T down", "dz", "dT")
_WHY_WORSE = (
    "Twice the thermal gain, or half the copper's lag, doubles the gain of a fast temperature loop, and the margin is",
    "2.4 (see above): a smaller `temperature_aggressiveness` swings less there. With 0.85 of the torque the speed that",
    "holds the temperature is near its bound, and the depth waits for it; the temperature has half the conservative",
    "PI's error.",
    "",
)
_WHY_LOST = (
    "Every loss is in comparison.json. Why they are lost:",
    "",
    "- Depth, ISE and some IAE: the tight tuning moves the force at its full rate and lets the temperature go by",
    "  some °C. The NMPC accelerates the depth only as fast as the speed can hold the temperature (to 0.1 °C).",
    "- Total variation: the speed holds the temperature while the depth moves, and force and speed together move the",
    "  temperature sooner. That costs movement in simulations without noise, where the PI tunings hardly move.",
    "- Peaks of the other output on processes that differ from the model: what the NMPC does to decouple the outputs",
    "  is then of the wrong size. They are small on the nominal process.",
    "- Saturation: the NMPC changes the temperature only as fast as the speed can, and keeps the depth.",
    "",
)
_BOUNDS = (
    "The clairvoyant optimum knows the process, the event and all that follows; every move is free within the drives'",
    "limits. The lower row minimises that output alone: no controller can be below it. The upper row minimises",
    "100 per mm and 1 per °C together.",
    "",
    "![Fronts between depth and temperature, and the controllers](fronts.png)",
    "",
)


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def _iae(found: Mapping[str, Any], event: str) -> str:
    """The figure that an event is about."""
    key = "iae_depth_mm_s" if EVENTS[event].of_depth else "iae_temperature_c_s"
    return f"{found[event][key]:.3g}"


def events(nominal: Mapping[str, Any], bounds: Mapping[str, Any], kind: str = "clean") -> list[str]:
    """IAE of each event, and the largest error it leaves in the other output."""
    found = {label: nominal[label][kind]["events"] for label in CONTROLLERS}
    rows = [[label, *(_iae(of, event) for event in _EVENTS)] for label, of in found.items()]
    if kind == "clean" and bounds:
        joint = {e: bounds[e]["joint"][0 if EVENTS[e].of_depth else 1] for e in _EVENTS}
        rows.append(["clairvoyant, both outputs", *(f"{joint[e]:.3g}" for e in _EVENTS)])
        rows.append(["clairvoyant, that output alone", *(f"{bounds[e]['alone']:.3g}" for e in _EVENTS)])
    lines = _table(["IAE", *(f"{e} [{'mm s' if EVENTS[e].of_depth else '°C s'}]" for e in _EVENTS)], rows)

    def other(event: Mapping[str, float], of_depth: bool) -> str:
        peak_c, peak_um = event["peak_temperature_error_c"], 1e3 * event["peak_depth_error_mm"]
        return f"{peak_c:.3g} °C" if of_depth else f"{peak_um:.3g} µm"

    crossed = [[label, *(other(of[e], EVENTS[e].of_depth) for e in _EVENTS)] for label, of in found.items()]
    return [*lines, *_table(["peak of the other output", *_EVENTS], crossed)]


def summary(nominal: Mapping[str, Any], bounds: Mapping[str, Any]) -> list[str]:
    """The README's table: each event's own error, and what depth steps do to the temperature."""
    columns = ("z up", "z down", "dz", "T up", "T down", "dT")
    rows = []
    for label in CONTROLLERS:
        found = nominal[label]["clean"]["events"]
        peak = max(found[e]["peak_temperature_error_c"] for e in columns if EVENTS[e].of_depth)
        rows.append([f"`{label}`", *(_iae(found, e) for e in columns), f"{peak:.2f}"])
    rows.append(["lower bound (clairvoyant optimum)", *(f"{bounds[e]['alone']:.3g}" for e in columns), ""])
    titles = [f"{'disturbance ' if e in DISTURBANCES else ''}{EVENTS[e].size}" for e in columns]
    return _table(["IAE [mm s], [°C s]", *titles, "peak °C in depth events"], rows)


def totals(nominal: Mapping[str, Any]) -> list[str]:
    """Whole cases, without noise, and movement at rest with noise."""
    header = ["", "tracking z / T", "disturbances z / T", "noisy tracking z / T", "noisy disturbances z / T"]
    header += ["force at rest [kN/s]", "speed at rest [rpm/s]"]
    rows = []
    for label in CONTROLLERS:
        cells = []
        for kind in ("clean", "noisy"):
            for case in CASES:
                found = nominal[label][kind][case]
                cells.append(f"{found['iae_depth_mm_s']:.3g} / {found['iae_temperature_c_s']:.3g}")
        rows.append([label, *cells, *(f"{nominal[label]['rest'][key]:.2g}" for key in VARIATIONS)])
    return _table(header, rows)


def sweep(data: Mapping[str, Any]) -> list[str]:
    """IAE on processes that differ from the model, and whether anything still swings at the end."""
    rows, skipped = [], []
    for name, runs in data.items():
        error = failed(runs)
        if error is not None:
            skipped.append(f"- {name}: not run: {error}")
            continue
        cells = [" / ".join(f"{runs[label][key]:.3g}" for label in FINALISTS) for key in JUDGED]
        swinging = ", ".join(label for label, run in runs.items() if run["swings"])
        rows.append([name, *cells, swinging or "–"])
    table = _table(["plant", *JUDGED.values(), "still swings at the end"], rows)
    return [*table, *skipped, *([""] if skipped else [])]


def worse_than_conservative(data: Mapping[str, Any]) -> list[str]:
    """Where the default NMPC is worse than the conservative PI on the same plant."""
    lines = []
    for name, runs in data.items():
        for key, title in JUDGED.items():
            if not failed(runs) and runs[DEFAULT][key] > runs[CONSERVATIVE][key]:
                lines.append(f"- {name}: {title}, {runs[DEFAULT][key] / runs[CONSERVATIVE][key]:.2f} times")
    return [*(lines or ["Nowhere."]), ""]


def margins(data: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Gain and delay margins."""
    rows = []
    for label, found in data.items():
        gains = ["> 8" if math.isinf(found[key]) else f"{found[key]:.2g}" for key in ("depth_gain", "temperature_gain")]
        rows.append([label, *gains, f"{found['depth_delay_s']:.1f} s", f"{found['temperature_delay_s']:.1f} s"])
    return _table(["", "depth: gain", "temperature: gain", "depth: delay", "temperature: delay"], rows)


def aggressiveness(data: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Gain margin against errors of the temperature."""
    rows = []
    for value, found in data.items():
        rows.append([value, f"{found['temperature_gain']:.2f}", *(f"{found[case]:.3g}" for case in CASES)])
    header = ["temperature_aggressiveness", "temperature: gain", *(f"{case}, IAE T [°C s]" for case in CASES)]
    return _table(header, rows)


def other_models(data: Mapping[str, Any]) -> list[str]:
    """Judged figures on other models: the NMPC by rule, and tunings searched for each."""
    rows = [
        [name, *(" / ".join(f"{runs[label][key]:.3g}" for label in FINALISTS) for key in JUDGED)]
        for name, runs in data.items()
    ]
    shares = [
        f"{title} {quantiles(values)['median']:.2f} (largest {max(values):.2f})"
        for (key, title), values in zip(JUDGED.items(), ratios(data, DECENTRALIZED).values(), strict=True)
    ]
    swinging = sum(runs[DEFAULT]["swings"] for runs in data.values())
    return [
        *_table(["model", *JUDGED.values()], rows),
        f"Default NMPC over the better PI, median: {'; '.join(shares)}.",
        f"It still swings at the end on {swinging} of these models.",
        "",
    ]


def random_plants(data: Mapping[str, Any]) -> list[str]:
    """Distribution of the ratio to the better PI tuning."""
    rows = []
    for key, values in ratios(data, DECENTRALIZED).items():
        q = quantiles(values)
        cells = [f"{q['median']:.2f}", f"{q['p95']:.2f}", f"{q['largest']:.2f}", f"{100 * q['share']:.0f} %"]
        rows.append([JUDGED[key], *cells])
    swings = {label: sum(bool(runs[label].get("swings")) for runs in data.values()) for label in FINALISTS}
    text = ", ".join(f"{label}: {count}" for label, count in swings.items())
    header = ["default NMPC over the better PI", "median", "95 %", "largest", "plants at or below 1"]
    return [*_table(header, rows), f"Plants on which something still swings at the end: {text}.", ""]


def wins(data: Mapping[str, Any]) -> list[str]:
    """How many KPIs are won, and by how much the others are lost."""
    lines = []
    for part in ("tuning", "validation"):
        won, total = data[part]
        lines.append(f"- events for {part}: {won} of {total} ({100 * won / max(total, 1):.1f} %)")
    by_kpi: dict[str, list[list[Any]]] = {}
    for loss in sorted(data["losses"], key=lambda loss: -loss[-1]):
        by_kpi.setdefault(loss[3], []).append(loss)
    rows = []
    for title, losses in sorted(by_kpi.items(), key=lambda item: -len(item[1])):
        name, case, noise, _, largest = losses[0]
        where = f"{case}{', noise' if noise else ''}, plant {name}"
        rows.append([title, str(len(losses)), f"{losses[len(losses) // 2][-1]:.2f}", f"{largest:.2f}", where])
    return [*lines, "", *_table(["lost", "runs", "median ratio", "largest", "where"], rows), *_WHY_LOST]


def page(data: Mapping[str, Any]) -> str:
    """All results as markdown."""
    kpis = "; ".join(KPIS.values())
    steps = ", ".join(f"{step.size} ({name})" for name, step in SET_POINTS.items())
    disturbances = " and ".join(f"{step.size} ({name})" for name, step in DISTURBANCES.items())
    parts = [
        "# Controllers compared",
        "",
        "Made by `python3 scripts/compare_controllers.py`; the same numbers are in comparison.json. All controllers",
        "see the same plant emulator, sensors and noise; errors are those of the true outputs. Set-point steps:",
        f"{steps}; disturbances of the outputs: {disturbances}.",
        "",
        "## Nominal process, without noise",
        "",
        *events(data["nominal"], data.get("bounds", {})),
        *(_BOUNDS if "bounds" in data else ()),
        "![Fig. 6](tracking_fig6.png)",
        "![Fig. 7](tracking_fig7.png)",
        "![Fig. 8](disturbances_fig8.png)",
        "![Fig. 9](disturbances_fig9.png)",
        "",
        "The paper mentions model uncertainties without showing them. Here the scenario `model_uncertainty`: seven",
        "parameters of the process are 10 to 50 % off at once.",
        "",
        "![Outputs](model_uncertainty_fig6.png)",
        "![Force and speed](model_uncertainty_fig7.png)",
        "",
        "## The corridors of the paper's tuning",
        "",
        "Preset `paper` with its corridors (32), (33) held at the set-point (constant), started once at the output",
        "(cold_start) and started at the output in every cycle (recentred), which the preset uses.",
        "",
        "![Outputs with each kind of corridor](corridors_fig6.png)",
        "![Force and speed with each kind of corridor](corridors_fig7.png)",
        "",
        "## With sensor noise",
        "",
        *events(data["nominal"], {}, "noisy"),
        *totals(data["nominal"]),
    ]
    if "margins" in data:
        parts += [
            "## Margins",
            "",
            "Largest factor on a loop's gain and largest delay added to it at which small steps still die out, the",
            "other loop closed; found by simulation.",
            "",
            *margins(data["margins"]),
            "A temperature loop that answers a disturbance sooner after the dead time has less gain margin. The NMPC's",
            "knob `temperature_aggressiveness` chooses, here without noise:",
            "",
            *aggressiveness(data["aggressiveness"]),
        ]
    parts += [
        "## Processes that differ from the model",
        "",
        "Sensor noise on. IAE of conservative PI / tight PI / default NMPC; depth in mm s, temperature in °C s.",
        "",
        *sweep(data["sweep"]),
        "Where the default NMPC is worse than the conservative PI:",
        "",
        *worse_than_conservative(data["sweep"]),
        *_WHY_WORSE,
        "![IAE relative to the conservative PI](sweep.png)",
        "",
    ]
    if "other_models" in data:
        parts += [
            "## Other models",
            "",
            f"{len(data['other_models'])} models with other gains, time constants and dead times. The NMPC is",
            "given the model and takes its tuning by rule; both decentralized tunings are searched for on each model.",
            "Without noise; conservative PI / tight PI / default NMPC. With `--models`; factors: other_models.json.",
            "",
            *other_models(data["other_models"]),
        ]
    if "random" in data:
        parts += [f"## {len(data['random'])} random plants", "", *random_plants(data["random"])]
        parts += ["![Distribution over random plants](random_plants.png)", ""]
    if "wins" in data:
        parts += [
            "## At or below both PI tunings",
            "",
            "The default NMPC over the nominal and nine other processes, without and with noise. A KPI counts as won",
            f"when it is at or below both PI tunings' (total variation: the tight one's) to 0.5 %. KPIs: {kpis}.",
            "",
            *wins(data["wins"]),
        ]
    return "\n".join(parts)
