#!/usr/bin/env python3
"""Compares the NMPC with the decentralized controller, the paper's NMPC and the physical limit: tables and figures.

Every controller runs the same events on the same plant: a set of events that the NMPC was tuned on, and a set of others
for validation; without and with sensor noise; and with processes that differ from the model. The physical limit (an
offline optimum with full knowledge, see ``fsw_nmpc.yardstick``) is the row that nobody can beat.

Results: ``comparison.json``, ``comparison.md`` and figures in the folder given by ``--out``.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml

from fsw_analysis.figures import Run, draw
from fsw_analysis.kpi import compute
from fsw_analysis.weld_signals import WeldSignals
from fsw_experiment import scenario_file
from fsw_experiment.closed_loop import ClosedLoop
from fsw_experiment.controllers import make
from fsw_experiment.scenario import Scenario, tick_of
from fsw_model import nominal
from fsw_nmpc.yardstick import Goal, Yardstick

CONSERVATIVE, TIGHT, PAPER, DEFAULT = "decentral:conservative", "decentral:tight", "nmpc:paper", "nmpc:default"
LIMIT, LIMIT_BOUNDED, LIMIT_PREVIEW = "limit", "limit, 0.15 °C", "limit, 8 s preview"
DECENTRALIZED = (CONSERVATIVE, TIGHT)
QUIET = ("plant.noise=false",)

#: key in ``fsw_analysis.kpi``, name, factor
KPIS = (
    ("iae_depth_mm_s", "IAE depth [mm s]", 1.0),
    ("iae_temperature_c_s", "IAE temperature [°C s]", 1.0),
    ("ise_depth_mm2_s", "ISE depth [mm² s]", 1.0),
    ("ise_temperature_c2_s", "ISE temperature [°C² s]", 1.0),
    ("peak_temperature_in_depth_step_up_c", "peak, depth step up [°C]", 1.0),
    ("peak_temperature_in_depth_step_down_c", "peak, depth step down [°C]", 1.0),
    ("peak_depth_in_temperature_step_mm", "peak, temperature step [µm]", 1e3),
    ("peak_temperature_after_depth_disturbance_c", "peak, depth disturbance [°C]", 1.0),
    ("peak_depth_after_temperature_disturbance_mm", "peak, temperature disturbance [µm]", 1e3),
    ("total_variation_force_kn", "total variation force [kN]", 1.0),
    ("total_variation_speed_rpm", "total variation speed [rpm]", 1.0),
)
#: of these the NMPC may have as much as the tight tuning has
VARIATIONS = ("total_variation_force_kn", "total_variation_speed_rpm")
#: a KPI is lost when it is worse than the better decentralized tuning by more than this share
TOLERANCE = 0.005


def set_point(at_s: float, **values: Any) -> dict[str, Any]:
    """Event: new set-points."""
    return {"at_s": at_s, "reference": values}


def disturbance(at_s: float, channel: str, amplitude: float) -> dict[str, Any]:
    """Event: step disturbance."""
    units = {"depth": "mm", "temperature": "c", "axial_force": "kn", "spindle_speed": "rpm"}
    return {
        "at_s": at_s,
        "disturbance": {"channel": channel, "shape": "step", f"amplitude_{units[channel]}": amplitude},
    }


#: own events; the other names are scenarios shipped with fsw_experiment
OWN: dict[str, tuple[float, list[dict[str, Any]]]] = {
    "steps": (
        240.0,
        [
            set_point(20.0, depth_mm=2.86),
            set_point(70.0, depth_mm=2.66),
            set_point(130.0, temperature_c=860.0),
            set_point(180.0, temperature_c=850.0),
        ],
    ),
    "disturbances": (240.0, [disturbance(20.0, "depth", 0.1), disturbance(160.0, "temperature", -5.0)]),
    "varied": (
        330.0,
        [
            set_point(10.0, depth_mm=2.56),
            set_point(40.0, depth_mm=2.71, over_s=5.0),
            set_point(70.0, temperature_c=844.0),
            set_point(110.0, temperature_c=852.0, over_s=12.0),
            disturbance(150.0, "depth", -0.05),
            disturbance(180.0, "temperature", 4.0),
            set_point(220.0, depth_mm=2.66, temperature_c=850.0),
            disturbance(255.0, "axial_force", 1.0),
            disturbance(280.0, "spindle_speed", -4.0),
            set_point(300.0, sine={"depth_mm": 0.03, "period_s": 25.0}),
        ],
    ),
    "other_sizes": (
        300.0,
        [
            set_point(10.0, depth_mm=2.72),
            set_point(50.0, depth_mm=2.57),
            set_point(90.0, temperature_c=854.0),
            set_point(130.0, temperature_c=842.0),
            disturbance(180.0, "depth", -0.12),
            disturbance(220.0, "temperature", 7.0),
            disturbance(265.0, "depth", 0.03),
        ],
    ),
    "mixed": (
        200.0,
        [
            set_point(10.0, depth_mm=2.78),
            set_point(50.0, temperature_c=856.0),
            disturbance(100.0, "depth", 0.06),
            disturbance(140.0, "temperature", -4.0),
        ],
    ),
}
TUNING = ("steps", "disturbances", "varied")
VALIDATION = ("other_sizes", "ramp_and_sine", "simultaneous_events", "quick", "model_uncertainty", "saturation")

#: factors on the parameters of the plant's model
MISMATCH: dict[str, dict[str, float]] = {
    "none": {},
    "dead time +21 %": {"dead_time_s": 3.4 / 2.8},
    "dead time -21 %": {"dead_time_s": 2.2 / 2.8},
    "thermal gain +20 %": {"thermal_gain_c_per_kw": 1.2},
    "thermal gain -20 %": {"thermal_gain_c_per_kw": 0.8, "ambient_temperature_c": (850.0 - 0.8 * 830.0) / 20.0},
    "depth gain +20 %": {"depth_gain_mm_per_kn_s": 1.2},
    "depth gain -20 %": {"depth_gain_mm_per_kn_s": 0.8},
    "torque +10 %": {"friction_coefficient": 1.1},
    "coupling x 1.5": {"softening_gain_mm_per_c": 1.5},
}
#: of the uncertainty study: independent, uniform; the dead time in whole ticks
UNCERTAIN: dict[str, tuple[float, float]] = {
    "thermal_gain_c_per_kw": (0.9, 1.15),
    "thermal_time_s": (0.8, 1.2),
    "depth_gain_mm_per_kn_s": (0.8, 1.2),
    "depth_zero_s": (0.9, 1.1),
    "friction_coefficient": (0.95, 1.1),
    "softening_gain_mm_per_c": (0.67, 1.5),
    "softening_time_s": (0.8, 1.2),
}


class Progress:
    """One line per run on the error output."""

    def __init__(self, total: int) -> None:
        self._total, self._done, self._began = total, 0, time.monotonic()

    def next(self, what: str) -> None:
        """Say what begins."""
        self._done += 1
        elapsed_s = time.monotonic() - self._began
        print(f"[{self._done:3}/{self._total}, {elapsed_s:5.0f} s] {what}", file=sys.stderr, flush=True)


def scenario(case: str, overrides: Sequence[str] = ()) -> Scenario:
    """An own or a shipped scenario."""
    if case not in OWN:
        return scenario_file.load(case, list(overrides))
    duration_s, events = OWN[case]
    text = yaml.safe_dump({"name": case, "duration_s": duration_s, "events": events})
    return scenario_file.parse(text, case, list(overrides))


def weld(label: str, case: str, overrides: Sequence[str]) -> WeldSignals:
    """Run one controller, e.g. ``nmpc:paper``, on one scenario."""
    name = label.partition(":")[0]
    made = scenario(case, [*overrides, f"controller={name}"])
    return ClosedLoop(made, {name: make(label)}).run()


def limit(case: str, like: WeldSignals, bound_c: float | None, preview_s: float) -> WeldSignals:
    """The physical limit of a scenario, in the form of the signals of a weld."""
    truth = like.truth
    assert truth is not None
    begins = sorted({tick_of(event.at_s) - 1 for event in scenario(case).events})
    ends = [*begins[1:], like.n_ticks]
    wanted = (
        like.reference_depth_mm - truth.depth_disturbance_mm,
        like.reference_temperature_c - truth.temperature_disturbance_c,
        np.append(truth.force_disturbance_kn[1:], truth.force_disturbance_kn[-1]),
        np.append(truth.speed_disturbance_rpm[1:], truth.speed_disturbance_rpm[-1]),
    )
    goals = [Goal(0, *(np.full(like.n_ticks, values[0]) for values in wanted))]
    for begin, end in zip(begins, ends, strict=True):
        known = [np.append(values[:end], np.full(like.n_ticks - end, values[end - 1])) for values in wanted]
        goals.append(Goal(begin, *known))
    best = Yardstick(nominal(), largest_temperature_error_c=bound_c, preview_s=preview_s).run(goals)
    if not best.solved:
        print(f"physical limit of {case}: a program was not solved to its tolerance", file=sys.stderr)
    return replace(
        like,
        force_kn=best.force_kn,
        speed_rpm=best.speed_rpm,
        statuses={},
        truth=replace(
            truth,
            depth_mm=like.reference_depth_mm + best.depth_error_mm,
            temperature_c=like.reference_temperature_c + best.temperature_error_c,
        ),
    )


def limit_kinds(case: str) -> list[tuple[str, float | None, float]]:
    """Label, bound on the temperature error and preview of the limits that are computed for a case."""
    kinds: list[tuple[str, float | None, float]] = [(LIMIT, None, 0.0), (LIMIT_BOUNDED, 0.15, 0.0)]
    return [*kinds, (LIMIT_PREVIEW, None, 8.0)] if case == "steps" else kinds  # only set-points can be known before


def figures_of_merit(signals: WeldSignals, label: str) -> dict[str, float]:
    """Those of ``KPIS`` that exist in a run."""
    values = compute(signals, label)
    return {key: float(values[key]) for key, _, _ in KPIS if values.get(key) is not None}


def losses(results: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """KPIs of the default NMPC that are not at or below both decentralized tunings, with their ratio."""
    lost: dict[str, float] = {}
    for key, value in results[DEFAULT].items():
        rivals = (TIGHT,) if key in VARIATIONS else DECENTRALIZED
        best = min(results[rival][key] for rival in rivals)
        if value > (1.0 + TOLERANCE) * best:
            lost[key] = value / best if best > 0.0 else float("inf")
    return lost


def lasting(signals: WeldSignals) -> dict[str, float]:
    """What remains in the last 20 s of a run: mean errors (offset) and swing of the spindle speed (oscillation)."""
    truth, last = signals.truth, slice(-200, None)
    assert truth is not None
    return {
        "offset_depth_mm": float(np.mean((truth.depth_mm - signals.reference_depth_mm)[last])),
        "offset_temperature_c": float(np.mean((truth.temperature_c - signals.reference_temperature_c)[last])),
        "swing_speed_rpm": float(np.ptp(signals.speed_rpm[last])),
    }


def overrides_of(factors: Mapping[str, float]) -> list[str]:
    """Scenario overrides for factors on the plant's model."""
    return [f"plant.model.{name}={factor!r}" for name, factor in factors.items()]


def draws(count: int) -> list[dict[str, float]]:
    """Processes of the uncertainty study."""
    generator = random.Random(2026)
    found = []
    for _ in range(count):
        factors = {name: generator.uniform(low, high) for name, (low, high) in UNCERTAIN.items()}
        found.append({"dead_time_s": generator.randint(22, 34) / 28.0, **factors})
    return found


def compare(cases: Sequence[str], limits: Sequence[str], out: Path, progress: Progress) -> dict[str, Any]:
    """Run all controllers on all cases, without and with noise."""
    results: dict[str, Any] = {}
    for case in cases:
        for noise in (False, True):
            found: dict[str, dict[str, float]] = {}
            runs: dict[str, WeldSignals] = {}
            for label in (*DECENTRALIZED, PAPER, DEFAULT):
                progress.next(f"{case}, {'noise' if noise else 'no noise'}, {label}")
                runs[label] = weld(label, case, () if noise else QUIET)
                found[label] = figures_of_merit(runs[label], label)
            if not noise and case in limits:
                for label, bound_c, preview_s in limit_kinds(case):
                    progress.next(f"{case}, {label}")
                    runs[label] = limit(case, runs[TIGHT], bound_c, preview_s)
                    found[label] = figures_of_merit(runs[label], label)
            if not noise:
                shown = [Run(label, runs[label]) for label in runs if label not in (PAPER, LIMIT, LIMIT_PREVIEW)]
                draw(shown, (6,) if case != "disturbances" else (8,), out, case)
            results[f"{case}, {'noise' if noise else 'no noise'}"] = found
    return results


def mismatch(processes: Mapping[str, Mapping[str, float]], progress: Progress) -> dict[str, Any]:
    """Run decentralized and default controllers on processes that differ from the model, noise-free."""
    results: dict[str, Any] = {}
    for name, factors in processes.items():
        found: dict[str, dict[str, float]] = {}
        for label in (*DECENTRALIZED, DEFAULT):
            progress.next(f"mismatch {name}, {label}")
            signals = weld(label, "mixed", [*QUIET, *overrides_of(factors)])
            found[label] = figures_of_merit(signals, label) | lasting(signals)
        results[name] = found
    return results


def table(results: Mapping[str, Mapping[str, float]]) -> list[str]:
    """KPIs as a markdown table: one row per controller; what the default NMPC loses is bold."""
    keys = [(key, name, factor) for key, name, factor in KPIS if any(key in found for found in results.values())]
    lost = losses(results)
    lines = ["| | " + " | ".join(name for _, name, _ in keys) + " |", "|---|" + "---:|" * len(keys)]
    for label, found in results.items():
        cells = [f"{found[key] * factor:.3g}" if key in found else "–" for key, _, factor in keys]
        if label == DEFAULT:
            cells = [f"**{cell}**" if key in lost else cell for cell, (key, _, _) in zip(cells, keys, strict=True)]
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return lines


def mismatch_table(results: Mapping[str, Mapping[str, Mapping[str, float]]]) -> list[str]:
    """Errors under mismatch relative to the better decentralized tuning, and what remains at the end."""
    lines = [
        "| process | IAE depth | IAE temperature | variation force | variation speed | offset [µm] | offset [°C] "
        "| swing of speed [rpm] |",
        "|---|" + "---:|" * 7,
    ]
    for name, found in results.items():
        own = found[DEFAULT]
        cells = []
        for key in ("iae_depth_mm_s", "iae_temperature_c_s", *VARIATIONS):
            rivals = (TIGHT,) if key in VARIATIONS else DECENTRALIZED
            cells.append(f"{own[key] / min(found[rival][key] for rival in rivals):.2f}")
        cells += [f"{1e3 * own['offset_depth_mm']:.2f}", f"{own['offset_temperature_c']:.3f}"]
        lines.append(f"| {name} | " + " | ".join([*cells, f"{own['swing_speed_rpm']:.2f}"]) + " |")
    return lines


def spread_table(results: Mapping[str, Mapping[str, Mapping[str, float]]]) -> list[str]:
    """Median and worst value over the uncertainty study, per controller."""
    keys = ("iae_depth_mm_s", "iae_temperature_c_s", *VARIATIONS, "swing_speed_rpm")
    names = {key: name for key, name, _ in KPIS} | {"swing_speed_rpm": "swing of speed at the end [rpm]"}
    lines = ["| median / worst | " + " | ".join(names[key] for key in keys) + " |", "|---|" + "---:|" * len(keys)]
    for label in (*DECENTRALIZED, DEFAULT):
        cells = []
        for key in keys:
            values = [found[label][key] for found in results.values()]
            cells.append(f"{np.median(values):.3g} / {max(values):.3g}")
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return lines


def report(data: Mapping[str, Any]) -> str:
    """All results as markdown."""
    lines = ["# Comparison of the controllers", "", "Bold: the default NMPC is worse than a decentralized tuning.", ""]
    names = {key: name for key, name, _ in KPIS}
    for part in ("tuning", "validation"):
        won = total = 0
        lost_lines = []
        for case, found in data[part].items():
            lost = losses(found)
            total, won = total + len(found[DEFAULT]), won + len(found[DEFAULT]) - len(lost)
            lost_lines += [f"- {case}: {names[key]}, {ratio:.2f} times" for key, ratio in lost.items()]
        lines += [f"## Events for {part}: {won} of {total} KPIs at or below both decentralized tunings", ""]
        lines += [*lost_lines, ""]
        for case, found in data[part].items():
            lines += [f"### {case}", "", *table(found), ""]
    lines += [
        "## Mismatch",
        "",
        "Errors and variations relative to the better decentralized tuning (variation: tight).",
        "",
    ]
    lines += [*mismatch_table(data["mismatch"]), ""]
    lines += [
        f"## Uncertainty study, {len(data['uncertainty'])} random processes",
        "",
        *spread_table(data["uncertainty"]),
        "",
    ]
    return "\n".join(lines)


def main() -> int:
    """Run the script; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a few runs only, less than a minute")
    parser.add_argument("--out", type=Path, default=Path("out/comparison"), help="folder for the results")
    parser.add_argument("--draws", type=int, default=24, help="processes of the uncertainty study (default 24)")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    quick: bool = arguments.quick
    tuning, validation = (("disturbances",), ("quick",)) if quick else (TUNING, VALIDATION)
    limits = ("disturbances",) if quick else ("steps", "disturbances", "varied", "other_sizes")
    processes = {name: MISMATCH[name] for name in ("dead time +21 %",)} if quick else MISMATCH
    uncertain = draws(1 if quick else max(arguments.draws, 1))
    n_limits = sum(len(limit_kinds(case)) for case in (*tuning, *validation) if case in limits)
    progress = Progress(8 * (len(tuning) + len(validation)) + n_limits + 3 * (len(processes) + len(uncertain)))
    data = {
        "tuning": compare(tuning, limits, out, progress),
        "validation": compare(validation, limits, out, progress),
        "mismatch": mismatch(processes, progress),
        "uncertainty": mismatch({f"process {i + 1}": factors for i, factors in enumerate(uncertain)}, progress),
        "uncertain_factors": uncertain,
    }
    (out / "comparison.json").write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
    text = report(data)
    (out / "comparison.md").write_text(text, encoding="utf-8")
    print(text)
    print(f"written: {out}/comparison.json, {out}/comparison.md and figures")
    return 0


if __name__ == "__main__":
    sys.exit(main())
