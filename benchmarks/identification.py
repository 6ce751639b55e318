#!/usr/bin/env python3
"""How well model parameters are identified: random plants, one closed-loop weld of five minutes each.

usage: identification.py [--quick] [--json FILE]
"""

import os
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "scripts"))
# one weld on one core
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

from report import parser, save, show

from fsw_analysis.identification.estimation import identify
from fsw_analysis.identification.weld_data import prepare
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_experiment.closed_loop import ClosedLoop
from fsw_experiment.comparison.cases import RANDOM, random_factors
from fsw_experiment.controllers import make
from fsw_experiment.scenario_file import load
from fsw_model import nominal
from fsw_plant.config import specs

#: largest medians of the relative errors, in percent; of the dead time in s
AIMS = {
    "thermal_gain_c_per_kw": 2.0,
    "depth_gain_mm_per_kn_s": 2.0,
    "copper_lag_s": 4.0,
    "tool_lag_s": 4.0,
    "dead_time_s": 0.05,
    "depth_zero_s": 5.0,
    "depth_pole_slow_s": 5.0,
}
#: factors on the paper's parameters: those of the comparison of controllers, and others that are estimated
SPANS = RANDOM | {"model.depth_pole_slow_s": (0.8, 1.25), "model.motor_lag_s": (0.7, 1.4)}
_95 = 1.96


def one(job):
    """Weld and identify one plant: relative error and standard deviation of every parameter, seconds, excursions."""
    index, factors = job
    overrides = [f"plant.seed={index + 1}", *(f"plant.{name}={factor!r}" for name, factor in factors.items())]
    scenario = load("identify_closed_loop", overrides)
    signals = ClosedLoop(scenario, {"decentral": make("decentral:conservative")}).run()
    began = time.process_time()
    fit = identify(prepare(signals, specs()["actuators.lag_s"].default).segments)
    seconds = time.process_time() - began
    truth = nominal().scaled(**{name.removeprefix("model."): factor for name, factor in factors.items()})
    errors = {name: getattr(fit.parameters, name) / getattr(truth, name) - 1.0 for name in fit.free}
    deviations = {name: fit.std[name] / getattr(fit.parameters, name) for name in fit.free}
    moved = abs(signals.truth.depth_mm - DEPTH_MM).max(), abs(signals.truth.temperature_c - TEMPERATURE_C).max()
    return errors, deviations, seconds, moved, len(fit.notes) + len(fit.shifts)


def main():
    """Measure, print a table, write JSON."""
    arguments = parser(__doc__, "8 plants instead of 100").parse_args()
    drawn = random_factors(8 if arguments.quick else 100, SPANS)
    runs, pool = [], ProcessPoolExecutor(os.cpu_count())
    try:
        for run in pool.map(one, enumerate(drawn)):
            runs.append(run)
            print(f"plant {len(runs)} of {len(drawn)}", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print(f"interrupted: of {len(runs)} plants only", file=sys.stderr)
    pool.shutdown(cancel_futures=True)
    result = {"plants": len(runs), "cpus": os.cpu_count()}
    names = list(dict.fromkeys(name for errors, *_ in runs for name in errors))
    inside = []
    for name in names:
        told = [(errors[name], deviations[name]) for errors, deviations, *_ in runs if name in errors]
        sizes = sorted(abs(error) for error, _ in told)
        in_s = name == "dead_time_s"
        scale = nominal().dead_time_s if in_s else 100.0
        unit = "s" if in_s else "percent"
        result[f"{name}_median_{unit}"] = scale * statistics.median(sizes)
        result[f"{name}_p95_{unit}"] = scale * sizes[int(0.95 * (len(sizes) - 1))]
        within = [abs(error) <= _95 * deviation for error, deviation in told]
        result[f"{name}_inside_95_percent"] = 100.0 * sum(within) / len(within)
        result[f"{name}_told"] = len(told)
        inside += within
    result["inside_95_percent"] = 100.0 * sum(inside) / len(inside)
    result["cpu_s_median"] = statistics.median(seconds for _, _, seconds, _, _ in runs)
    result["cpu_s_largest"] = max(seconds for _, _, seconds, _, _ in runs)
    result["depth_excursion_mm_largest"] = max(moved[0] for *_, moved, _ in runs)
    result["temperature_excursion_c_largest"] = max(moved[1] for *_, moved, _ in runs)
    result["false_alarms"] = sum(count for *_, count in runs)
    show(result)
    for name, aim in AIMS.items():
        found = next(value for key, value in result.items() if key.startswith(f"{name}_median"))
        print(f"{name:<26} median {found:8.3g}  aim: <= {aim:g}  {'met' if found <= aim else 'MISSED'}")
    print(f"{'inside the 95 % intervals':<26} {result['inside_95_percent']:.1f} %  aim: 90 to 98 %")
    save(result, arguments.json)


if __name__ == "__main__":
    main()
