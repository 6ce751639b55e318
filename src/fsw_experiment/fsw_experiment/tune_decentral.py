"""Tunes the decentralized controller for a process model and tells what a tuning is worth.

Minimises the errors in set-point steps and output disturbances under bounds: on the peak Ms of the sensitivity of each
loop with the other one closed and one whole tick of delay added, and on the moves that sensor noise causes. A figure
above its target costs much more than the same figure below it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import fsw_decentral
from fsw_decentral import Gains, tunings
from fsw_experiment.cli.errors import CommandError
from fsw_experiment.cli.outputs import add_force, check_new
from fsw_experiment.cli.progress import ProgressBar
from fsw_experiment.decentral_loop import errors, noise_moves, sensitivity, simulated_sensitivity
from fsw_model import ModelParameterError, ModelParameters, OperatingPointError, nominal

Vector = NDArray[np.float64]
#: A bound and a target are kept with so much to spare, so that they hold after rounding.
_BOUND_MARGIN, _TARGET_MARGIN = 0.985, 0.995
#: cost of exceeding a target and a bound, per share of it
_MISSED, _BROKEN = 5.0, 50.0
#: beyond this excess over the bounds a run is not worth its time; the loop may be unstable
_HOPELESS = 0.5
_SWINGING_C = 2.0
#: how far the first simplex of the search reaches from the start, in logarithms of the gains
_REACH = 0.25
_EVALUATIONS = 3000


NAMES = ("conservative", "tight")


def _of_each(table: dict[str, tuple[float, float]]) -> dict[str, dict[str, float]]:
    """Columns of a table, by the names of the tunings."""
    return {name: {key: row[i] for key, row in table.items()} for i, name in enumerate(NAMES)}


#: What a set of gains may not exceed: Ms of each loop, standard deviation of the moves per tick under sensor noise.
BOUNDS = _of_each(
    {
        "ms_depth": (1.6, 2.0),
        "ms_temperature": (1.6, 2.0),
        "noise_move_kn": (0.03, 0.12),
        "noise_move_rpm": (0.5, 0.8),
    }
)
#: What the search aims to stay below: figures of another, independent tuning of such loops on the paper's process.
TARGETS = _of_each(
    {
        "tracking_iae_depth_mm_s": (4.08, 1.48),
        "tracking_iae_temperature_c_s": (300.0, 207.0),
        "disturbance_iae_depth_mm_s": (0.93, 0.34),
        "disturbance_iae_temperature_c_s": (45.0, 45.0),
        "depth_up_iae_mm_s": (1.82, 0.679),
        "depth_down_iae_mm_s": (1.78, 0.654),
        "depth_disturbance_iae_mm_s": (0.778, 0.302),
        "temperature_up_iae_c_s": (136.0, 82.4),
        "temperature_down_iae_c_s": (137.0, 84.1),
        "temperature_disturbance_iae_c_s": (39.1, 38.3),
        "depth_up_peak_c": (0.85, 1.42),
        "depth_down_peak_c": (0.86, 3.24),
        "depth_disturbance_peak_c": (0.86, 3.24),
    }
)

#: Searched for, with the range: all gains. The unit is that of the gain. The events hardly reach the bounds of the
#: speed, so the range is what keeps the tracking times short enough for a speed that rests at a bound.
SEARCHED = {
    "depth_gain": (1.0, 500.0),
    "depth_integral_time": (0.3, 100.0),
    "depth_derivative_time": (0.001, 2.0),
    "depth_filter": (0.02, 5.0),
    "depth_weight": (0.001, 1.0),
    "depth_reference_filter": (0.01, 20.0),
    "depth_tracking_time": (0.1, 100.0),
    "temperature_gain": (0.01, 2.0),
    "temperature_integral_time": (3.0, 200.0),
    "temperature_derivative_time": (0.001, 4.0),
    "temperature_filter": (0.02, 5.0),
    "temperature_weight": (0.01, 1.0),
    "temperature_reference_filter": (0.01, 20.0),
    "temperature_tracking_time": (1.0, 25.0),
    "power_gain": (0.02, 15.0),
    "power_integral_time": (0.2, 20.0),
    "power_filter": (0.02, 3.0),
    "power_tracking_time": (0.1, 30.0),
    "feedforward_filter": (0.02, 10.0),
}

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


def start_of(name: str, parameters: ModelParameters) -> Gains:
    """Where the search for one of ``NAMES`` starts: internal model control of the loops by themselves."""
    p, tight = parameters, name == "tight"
    closed_s = (1.0 if tight else 1.4) * p.dead_time_s
    heat_c_per_kw_s = p.thermal_gain_c_per_kw / p.copper_lag_s
    creep_mm_per_kn_s = p.depth_gain_mm_per_kn_s * p.depth_zero_s / p.depth_pole_slow_s
    return Gains(
        depth_gain=(0.6 if tight else 0.25) / creep_mm_per_kn_s,
        depth_integral_time=3.0 if tight else 5.5,
        depth_derivative_time=0.05,
        depth_filter=0.2 if tight else 0.5,
        depth_weight=0.07 if tight else 0.3,
        depth_reference_filter=0.05 if tight else 1.0,
        depth_tracking_time=0.2 if tight else 1.0,
        temperature_gain=1.0 / (heat_c_per_kw_s * (closed_s + p.dead_time_s)),
        temperature_integral_time=p.copper_lag_s + p.tool_lag_s,
        temperature_derivative_time=1.5 * p.tool_lag_s,
        temperature_filter=0.35 * p.tool_lag_s,
        temperature_weight=0.95,
        temperature_reference_filter=0.1 if tight else 1.0,
        temperature_tracking_time=20.0,
        power_gain=2.0 if tight else 1.5,
        power_integral_time=0.25,
        power_filter=0.15,
        power_tracking_time=20.0,
        feedforward_filter=0.15 if tight else 0.25,
    )


def robustness(gains: Gains, parameters: ModelParameters) -> dict[str, float]:
    """The figures of a set of gains that have ``BOUNDS``."""
    peaks, moves = sensitivity(gains, parameters), noise_moves(gains, parameters)
    return {"ms_depth": peaks[0], "ms_temperature": peaks[1], "noise_move_kn": moves[0], "noise_move_rpm": moves[1]}


def cost(gains: Gains, name: str, parameters: ModelParameters) -> float:
    """Mean of the figures as shares of their targets, with penalties for missed targets and broken bounds."""
    robust = robustness(gains, parameters)
    excess = sum(max(robust[key] / bound - _BOUND_MARGIN, 0.0) for key, bound in BOUNDS[name].items())
    hopeless = 1e3 + min(excess, 1e3)
    if excess > _HOPELESS:
        return hopeless
    try:
        found = errors(gains, parameters)
    except OperatingPointError:
        return hopeless
    shares = np.array([found[key] / target for key, target in TARGETS[name].items()])
    missed = np.maximum(shares - _TARGET_MARGIN, 0.0).sum()
    swing = max(found["unsettled_c"] - _SWINGING_C, 0.0)
    return float(shares.mean() + _MISSED * missed + _BROKEN * (excess + swing))


def tune(
    name: str,
    parameters: ModelParameters | None = None,
    evaluations: int = _EVALUATIONS,
    progress: Callable[[float], None] | None = None,
) -> Gains:
    """Search for a set of gains, from ``start_of`` on.

    Parameters
    ----------
    name : str
        One of ``NAMES``.
    parameters : ModelParameters, optional
        The paper's by default.
    evaluations : int
        At most; of the cost, some 0.1 s each.
    progress : callable, optional
        Called with the share of the evaluations done, 0 to 1.

    Returns
    -------
    Gains
        Rounded to three digits.
    """
    p = parameters or nominal()
    start = start_of(name, p)
    ranges = np.log(list(SEARCHED.values()))
    done = 0

    def gains_of(x: Vector) -> Gains:
        return replace(start, **{key: float(f"{v:.3g}") for key, v in zip(SEARCHED, np.exp(x), strict=True)})

    def cost_of(x: Vector) -> float:
        nonlocal done
        done += 1
        if progress is not None:
            progress(min(done / evaluations, 1.0))
        return cost(gains_of(x), name, p)

    x = np.clip(np.log([getattr(start, key) for key in SEARCHED]), *ranges.T)
    reach = np.where(x + _REACH <= ranges[:, 1], _REACH, -_REACH)
    simplex = np.vstack([x, x + np.diag(reach)])
    options = {"adaptive": True, "initial_simplex": simplex, "maxfev": evaluations}
    return gains_of(minimize(cost_of, x, method="Nelder-Mead", bounds=ranges, options=options).x)


def report(sets: dict[str, Gains], parameters: ModelParameters) -> dict[str, dict[str, float]]:
    """Print gains, figures with targets, and the check against mismatch, side by side; return the figures."""
    _print_row("", sets)
    for field in fields(Gains):
        _print_row(field.name, (f"{getattr(gains, field.name):g}" for gains in sets.values()))
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
        lines += [f"  {key}: {value!r}" for key, value in asdict(gains).items()]
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
    parser.add_argument("--evaluations", type=_count, default=_EVALUATIONS, help="per tuning (default %(default)s)")
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
    except (CommandError, ModelParameterError, OperatingPointError) as error:
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
