"""The command of the study: search for the decentralized controller's gains, or assess the shipped ones.

usage: tune_decentral.py [--check] [--tuning NAME] [--model FILE] [--evaluations N] [--write] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path

import fsw_decentral
from fsw.errors import CommandError
from fsw.outputs import add_force, check_new
from fsw.progress import ProgressBar
from fsw_control.schema import InputError
from fsw_decentral import Gains, tunings
from fsw_model import ModelParameters, OperatingPointError, nominal
from fsw_scenario.decentral_loop import errors, simulated_sensitivity
from fsw_scenario.tune_decentral import BOUNDS, EVALUATIONS, NAMES, TARGETS, robustness, tune

#: factors on model parameters, for the check of a tuning on other processes than that it was made for
MISMATCH = {
    "as tuned for": {},
    "dead time -20 %": {"dead_time_s": 0.8},
    "dead time +20 %": {"dead_time_s": 1.2},
    "thermal gain -20 %": {"thermal_gain_c_per_kw": 0.8},
    "thermal gain +20 %": {"thermal_gain_c_per_kw": 1.2},
    "depth gain +20 %": {"depth_gain_mm_per_kn_s": 1.2},
    "coupling x 1.5": {"softening_per_c": 1.5},
}


def report(sets: dict[str, Gains], parameters: ModelParameters) -> dict[str, dict[str, float]]:
    """Print gains, figures with targets, and the check against mismatch, side by side; return the figures."""
    _print_row("", sets)
    for name in Gains.model_fields:
        _print_row(name, (f"{getattr(gains, name):g}" for gains in sets.values()))
    figures = {name: robustness(gains, parameters) | errors(gains, parameters) for name, gains in sets.items()}
    print()
    _print_row("", (f"{name} (most)" for name in sets))
    most = {name: BOUNDS[name] | TARGETS[name] for name in sets}
    for key in next(iter(figures.values())):
        limits = {name: f" ({most[name][key]:g})" if key in most[name] else "" for name in sets}
        _print_row(key, (f"{found[key]:.4g}{limits[name]}" for name, found in figures.items()))
    print("\nMs of depth / temperature, IAE in mm s / degC s with disturbances; on a process with")
    for label, factors in MISMATCH.items():
        other = parameters.scaled(**factors)
        _print_row(label, (_on_other_process(gains, other) for gains in sets.values()))
    return figures


def _print_row(label: str, cells: Iterable[str]) -> None:
    print(f"{label:34}" + "".join(f"{cell:>24}" for cell in cells))


def _on_other_process(gains: Gains, parameters: ModelParameters) -> str:
    depth, temperature = simulated_sensitivity(gains, parameters)
    try:
        found = errors(gains, parameters)
    except OperatingPointError:
        return "leaves the copper"
    iae = f"{found['disturbance_iae_depth_mm_s']:.2f}/{found['disturbance_iae_temperature_c_s']:.1f}"
    return f"{depth:.2f}/{temperature:.2f}  {iae}"


def as_yaml(sets: dict[str, Gains], figures: dict[str, dict[str, float]]) -> str:
    """The sets as text of the package's ``tunings.yaml``."""
    lines = ["# Computed by scripts/tune_decentral.py; meaning and units of the gains: decentral.yaml."]
    for name, gains in sets.items():
        of = figures[name]
        lines.append(
            f"# {name}, Ms <= {BOUNDS[name]['ms_depth']:g}: "
            f"depth {of['ms_depth']:.2f}, temperature {of['ms_temperature']:.2f}; "
            f"moves by noise {of['noise_move_kn']:.3f} kN, {of['noise_move_rpm']:.2f} rpm"
        )
        lines.append(f"{name}:")
        lines += [f"  {key}: {value!r}" for key, value in dict(gains).items()]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code: 0 done, 1 not possible, 2 wrong arguments, 130 interrupted."""
    parser = argparse.ArgumentParser(
        prog="tune_decentral.py",
        description="Search for gains of the decentralized controller on the process model and print gains, "
        "robustness and errors. Without --write the shipped tunings stay as they are.",
    )
    parser.add_argument("--check", action="store_true", help="assess the shipped gains, do not search")
    parser.add_argument("--tuning", choices=NAMES, help="search for this one only; the other is as shipped")
    parser.add_argument("--model", type=Path, metavar="FILE", help="YAML with model parameters other than the paper's")
    parser.add_argument("--evaluations", type=_count, default=EVALUATIONS, help="per tuning (default %(default)s)")
    parser.add_argument("--write", action="store_true", help="write the result into the package fsw_decentral")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write gains and figures as JSON")
    add_force(parser)
    parsed = parser.parse_args(arguments)
    if parsed.write and parsed.model:
        parser.error("--write is for the tunings of the paper's process: leave out --model, or use --json")
    if parsed.write and parsed.check:
        parser.error("--check changes nothing: leave out --write")
    try:
        _run(parsed)
    except (CommandError, InputError, OperatingPointError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


def _count(text: str) -> int:
    if not (text.isdecimal() and 1 <= int(text) <= 1_000_000):
        raise argparse.ArgumentTypeError(f"{text!r}: give a whole number from 1 to 1000000")
    return int(text)


def _run(parsed: argparse.Namespace) -> None:
    parameters = nominal()
    if parsed.model is not None:
        parameters = ModelParameters.from_file(parsed.model)
    if parsed.json is not None:
        check_new([parsed.json], parsed.force)
        _save(parsed.json, "")  # better now than after the search
    sets = dict(tunings())
    for name in [] if parsed.check else [parsed.tuning] if parsed.tuning else NAMES:
        bar = ProgressBar(f"tuning {name}")
        sets[name] = tune(name, parameters, parsed.evaluations, bar)
        bar.done()
    figures = report(sets, parameters)
    if parsed.json is not None:
        found = {name: {"gains": asdict(sets[name]), "figures": of} for name, of in figures.items()}
        _save(parsed.json, json.dumps(found, indent=2) + "\n")
    if parsed.write:
        _save(Path(fsw_decentral.__file__).parent / "tunings.yaml", as_yaml(sets, figures))


def _save(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"cannot write {path}: {error.strerror}") from None


if __name__ == "__main__":
    sys.exit(main())
