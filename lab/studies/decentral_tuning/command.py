"""The command of the study: search for the decentralized controller's gains, or assess the shipped ones."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import fsw_decentral
from fsw.console import ProgressBar, print_table
from fsw.outputs import write_text
from fsw_decentral import Gains, tunings
from fsw_model import ModelParameters, OperatingPointError, nominal
from fsw_tuning.decentral_loop import errors, simulated_sensitivity
from fsw_tuning.tune_decentral import BOUNDS, EVALUATIONS, NAMES, TARGETS, robustness, tune

#: factors on model parameters, for the check of a tuning on other processes than that it was made
#: for
MISMATCH = {
    "as tuned for": {},
    "dead time -20 %": {"dead_time_s": 0.8},
    "dead time +20 %": {"dead_time_s": 1.2},
    "thermal gain -20 %": {"thermal_gain_c_per_kw": 0.8},
    "thermal gain +20 %": {"thermal_gain_c_per_kw": 1.2},
    "depth gain +20 %": {"depth_gain_mm_per_kn_s": 1.2},
    "coupling x 1.5": {"softening_per_c": 1.5},
}


def report(sets: dict[str, Gains]) -> dict[str, dict[str, float]]:
    """Print gains, figures with targets, and the check against mismatch, side by side; return the figures."""
    rows = [
        [name, *(f"{getattr(gains, name):g}" for gains in sets.values())]
        for name in Gains.model_fields
    ]
    print_table(rows, ["gain", *sets], words=1)
    figures = {name: robustness(gains, nominal()) | errors(gains) for name, gains in sets.items()}
    most = {name: BOUNDS[name] | TARGETS[name] for name in sets}
    rows = []
    for key in next(iter(figures.values())):
        limits = {name: f" ({most[name][key]:g})" if key in most[name] else "" for name in sets}
        rows.append([key, *(f"{found[key]:.4g}{limits[name]}" for name, found in figures.items())])
    print()
    print_table(rows, ["figure", *(f"{name} (most)" for name in sets)], words=1)
    print("\nMs of depth / temperature, IAE in mm s / degC s with disturbances")
    rows = []
    for label, factors in MISMATCH.items():
        other = nominal().scaled(**factors)
        rows.append([label, *(_on_other_process(gains, other) for gains in sets.values())])
    print_table(rows, ["process", *sets], words=1)
    return figures


def _on_other_process(gains: Gains, parameters: ModelParameters) -> str:
    depth, temperature = simulated_sensitivity(gains, parameters)
    try:
        found = errors(gains, parameters)
    except OperatingPointError:
        return "leaves the copper"
    iae = (
        f"{found['disturbance_iae_depth_mm_s']:.2f}/{found['disturbance_iae_temperature_c_s']:.1f}"
    )
    return f"{depth:.2f}/{temperature:.2f}  {iae}"


def as_yaml(sets: dict[str, Gains], figures: dict[str, dict[str, float]]) -> str:
    """The sets as text of the package's ``tunings.yaml``."""
    lines = [
        "# Computed by scripts/tune_decentral.py; meaning and units of the gains: parameters.py."
    ]
    for name, gains in sets.items():
        found = figures[name]
        lines.append(
            f"# {name}, Ms <= {BOUNDS[name]['ms_depth']:g}: "
            f"depth {found['ms_depth']:.2f}, temperature {found['ms_temperature']:.2f}; "
            f"moves by noise {found['noise_move_kn']:.3f} kN, {found['noise_move_rpm']:.2f} rpm"
        )
        lines.append(f"{name}:")
        lines += [
            f"  {key}: {value!r}" for key, value in gains.model_dump(exclude_defaults=True).items()
        ]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="tune_decentral.py",
        description="Search for gains of the decentralized controller on the process model and print gains, "
        "robustness and errors. Without --write the shipped tunings stay as they are.",
    )
    parser.add_argument(
        "--check", action="store_true", help="assess the shipped gains, do not search"
    )
    parser.add_argument(
        "--tuning", choices=NAMES, help="search for this one only; the others are as shipped"
    )
    parser.add_argument(
        "--evaluations", type=int, default=EVALUATIONS, help="per tuning (default %(default)s)"
    )
    parser.add_argument(
        "--write", action="store_true", help="write the result into the package fsw_decentral"
    )
    parsed = parser.parse_args(arguments)
    if parsed.write and parsed.check:
        parser.error("--write is for gains that were searched for: leave out --check")
    sets = dict(tunings())
    for name in [] if parsed.check else [parsed.tuning] if parsed.tuning else NAMES:
        with ProgressBar(f"tuning {name}") as bar:
            sets[name] = tune(name, nominal(), parsed.evaluations, bar)
    figures = report(sets)
    if parsed.write:
        write_text(Path(fsw_decentral.__file__).parent / "tunings.yaml", as_yaml(sets, figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
