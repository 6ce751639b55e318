#!/usr/bin/env python3
"""How the model of a machine gets better from weld to weld.

Identification with the last weld's estimate as the prior.

usage: weld_to_weld.py [--quick] [--json FILE]

Random machines, each with a series of short ordinary welds between which its process changes a
little.
"""

import _benchmark
import numpy as np
from identification import SPANS

import fsw
from controller_comparison.processes import random_factors
from fsw_identification.problem import STEP
from fsw_identification.summary import STRANGE
from fsw_model import nominal
from fsw_scenario.scenario_file import content_of, text_of
from fsw_tuning.standard_cases import cut_joint_line

MACHINES, WELDS, SEED = 8, 8, 1947  #: of a seed that nothing else has
AFTER = (1, 2, 4, 8)  #: welds, of which the page has the errors
#: end of the joint line of a weld; a whole one ends at 380 degrees and takes 45 minutes
END_DEG = 45.0
SHOWN = (
    "thermal_gain_c_per_kw",
    "copper_lag_s",
    "tool_lag_s",
    "dead_time_s",
    "depth_gain_mm_per_kn_s",
    "depth_zero_s",
    "softening_per_c",
    "sliding_friction",
)
_95 = 1.96


def ordinary(model, seed):
    """``canister_weld`` with a short joint line, on a process of these parameters."""
    content = content_of(text_of("canister_weld"))
    cut_joint_line(content, END_DEG)
    factors = {
        f"factors.{name}": getattr(model, name) / getattr(nominal(), name)
        for name in (key.removeprefix("factors.") for key in SPANS)
    }
    content["plant"] = {"seed": seed, **factors}
    return fsw.simulate(content, "decentral:conservative")


def series(job):
    """By weld, each parameter's relative error with its standard deviation; strange welds.

    Minutes of a weld.
    """
    index, factors = job
    generator = np.random.default_rng((SEED, index))
    names = [name.removeprefix("factors.") for name in factors]
    truth = nominal().scaled(**dict(zip(names, factors.values(), strict=True)))
    model, prior, rows, strange = None, None, [], 0
    for weld in range(WELDS):
        welded = ordinary(truth, 100 * index + weld)
        estimate = fsw.identify(welded, start=model, prior=prior)
        fit = estimate.fit
        rows.append(
            {
                name: (
                    float(np.log(getattr(fit.parameters, name) / getattr(truth, name))),
                    float(std),
                )
                for name, std in zip(fit.free, np.sqrt(np.diag(fit.covariance)), strict=True)
            }
        )
        strange += any(size > STRANGE for size in fit.moved.values())
        model, prior = estimate.parameters, estimate.covariance
        steps = np.exp(STEP * generator.standard_normal(len(names)))
        truth = truth.scaled(**dict(zip(names, map(float, steps), strict=True)))
    return rows, strange, float(welded.signals.time_s[-1]) / 60.0


def figures(runs):
    """RMS of errors [%] and deviations, and shares of true values inside the intervals."""
    summary = {
        "machines": len(runs),
        "strange": sum(strange for _, strange, _ in runs),
        "minutes": max(minutes for *_, minutes in runs),
    }
    for after in AFTER:
        welds = [rows[after - 1] for rows, *_ in runs]
        for name in SHOWN:
            values = [weld[name] for weld in welds if name in weld]
            for word, of in zip(("error", "std"), np.square(values).T, strict=True):
                summary[f"{name} {word} {after}"] = 100.0 * float(np.sqrt(np.mean(of)))
    by_name = {}
    for name, (error, std) in (item for rows, *_ in runs for row in rows for item in row.items()):
        by_name.setdefault(name, []).append(abs(error) < _95 * std)
    summary["doubtful"] = min(by_name, key=lambda name: np.mean(by_name[name]))
    summary["doubtful inside"] = 100.0 * float(np.mean(by_name[summary["doubtful"]]))
    every = [value for rows, *_ in runs for row in rows for value in row.values()]
    summary["values"] = len(every)
    summary["inside"] = 100.0 * float(np.mean([abs(error) < _95 * std for error, std in every]))
    summary["largest"] = max(abs(error) / std for error, std in every)
    return summary


def measure(quick):
    """Figures, and the content of the page."""
    drawn = random_factors(1 if quick else MACHINES, SPANS, seed=SEED)
    errors = figures(_benchmark.each(series, enumerate(drawn), "machines:"))
    return errors, globals() | {"figures": errors}


if __name__ == "__main__":
    _benchmark.run(__doc__, "one machine, no page", measure, "weld-to-weld")
