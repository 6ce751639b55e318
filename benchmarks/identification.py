#!/usr/bin/env python3
"""How well model parameters are identified.

Random plants, one closed-loop weld of five minutes each.

Once without disturbances, and once with a random one of the process or a sensor in each weld: how
often is a parameter then off by more than three of its standard deviations, and how often without
a word about a disturbance? And on whole welds of 45 minutes (``canister_weld``). And on canisters
that conduct heat, which have another structure: how well does the identified model predict another
weld, compared with the paper's? And on plants with other sensors than the model's, with noise that
is correlated or a thermocouple that lags.

usage: identification.py [--quick] [--part PART ...] [--json FILE]
"""

import os
import random
import resource
import statistics
import sys
import time
from dataclasses import replace
from typing import NamedTuple

import _benchmark
import numpy as np
import pandas as pd
import scipy

import fsw
from controller_comparison.processes import RANDOM, SENSING, random_factors
from fsw_campaign.definition import load
from fsw_control.parameters import describe
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_identification.estimation import identify
from fsw_identification.problem import measured
from fsw_identification.simulation import DEPTH, OUTPUTS, respond
from fsw_identification.statistics import autocorrelation_of
from fsw_identification.summary import Summary, disturbances
from fsw_identification.weld_data import prepare
from fsw_model import nominal
from fsw_plant.parameters import Actuators, PlantParameters
from fsw_scenario.scenario_file import content_of, text_of

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
#: factors on the paper's parameters: those of the comparison of controllers, and others that are
#: estimated
SPANS = RANDOM | {"factors.depth_pole_slow_s": (0.8, 1.25), "factors.motor_lag_s": (0.7, 1.4)}
_95 = 1.96
EXPERIMENT, WHOLE_WELD = "identify_closed_loop", "canister_weld"
#: what is predicted where the plant starts in equilibrium
JUDGE = "reference_tracking"
#: of a weld on a canister, until what was before it is over
SETTLED_TICKS = 600
#: a relative error that matters
GROSS = 0.1
#: a parameter that is off by more standard deviations is biased
BIASED = 3.0
#: noise of the method's colour, and a disturbance of the process or a sensor with it
DISTURBED = "correlated 1 s, disturbed"
#: smallest and largest amplitudes of disturbances, and of sensor faults (a drift: per second)
AMPLITUDES = {
    "depth": ("mm", 0.02, 0.1),
    "temperature": ("c", 1.0, 5.0),
    "axial_force": ("kn", 0.3, 1.5),
    "torque": ("nm", 10.0, 60.0),
}
FAULTS = {"depth": ("mm", 0.02, 0.1), "thermocouple": ("c", 1.0, 5.0)}
#: correlation times [s] of two parts of the noise, each of half its variance: none is of the
#: method's
MIXED = {"white and 5 s": (0.0, 5.0), "0.5 and 10 s": (0.5, 10.0)}
KINDS = (*SENSING, *MIXED, DISTURBED)


class Run(NamedTuple):
    """What came of the identification of a plant."""

    errors: dict[str, float]  #: relative, of each parameter
    deviations: dict[str, float]  #: their standard deviations
    seconds: float
    remarks: list[str]  #: about disturbances
    excursions: list[float] = []  #: depth [mm] and temperature [degC]
    memory_mb: float = 0.0  #: largest of this process so far
    ratios: dict[str, float] = {}  #: of errors of predictions, to those of the paper's model
    not_white: bool = False  #: whether a remark says so
    lag_s: tuple[float, float] | None = None  #: of the thermocouple, with its standard deviation
    correlation_s: list[float] = []  #: of the noise of each output


def disturbance(index):
    """A random event of the scenario's kind: disturbance of any shape, or fault of a sensor."""
    generator = random.Random(index)
    at_s = round(generator.uniform(30.0, 200.0), 1)
    sign = generator.choice((-1.0, 1.0))
    if generator.random() < 0.2:
        sensor = generator.choice(list(FAULTS))
        unit, low, high = FAULTS[sensor]
        kind = generator.choice(("bias", "drift"))
        duration_s = round(generator.uniform(20.0, 80.0), 1)
        size = sign * generator.uniform(low, high) / (1.0 if kind == "bias" else duration_s)
        return {"at_s": at_s, "fault": {"sensor": sensor, "kind": kind, f"magnitude_{unit}": size,
                                        "duration_s": duration_s}}  # fmt: skip
    channel = generator.choice(("depth", "depth", "temperature", "axial_force", "torque"))
    unit, low, high = AMPLITUDES[channel]
    entry = {"channel": channel, "shape": generator.choice(("step", "ramp", "sine", "pulse"))}
    entry[f"amplitude_{unit}"] = sign * generator.uniform(low, high)
    if entry["shape"] != "step":
        entry["duration_s"] = round(generator.uniform(5.0, 80.0), 1)
    if entry["shape"] == "sine":
        entry["period_s"] = round(generator.uniform(10.0, 90.0), 1)
    return {"at_s": at_s, "disturbance": entry}


def welded(name, plant, event=None):
    """A closed-loop weld with these parameters of the plant."""
    content = content_of(text_of(name))
    if event is not None:
        content["events"] = sorted([*content["events"], event], key=lambda entry: entry["at_s"])
    return fsw.simulate(content, "decentral:conservative", plant=plant)


def noisy(segment, correlations_s, seed):
    """A segment with nominal noise, in parts of equal variance with these correlation times."""
    names = ("sensors.depth_noise_mm", "sensors.temperature_noise_c", "sensors.torque_noise_nm")
    sizes = np.array([describe(PlantParameters)[name].default for name in names]) / np.sqrt(
        len(correlations_s)
    )
    generator, measured = np.random.default_rng(seed), segment.measured.copy()
    for correlation_s in correlations_s:
        autocorrelation = autocorrelation_of(correlation_s) if correlation_s else 0.0
        fresh = generator.standard_normal(measured.shape)
        fresh[1:] *= np.sqrt(1.0 - autocorrelation**2)
        measured += sizes * scipy.signal.lfilter([1.0], [1.0, -autocorrelation], fresh, axis=0)
    return replace(segment, measured=measured)


def identified(job):
    """Weld and identify one plant."""
    index, factors, event, name = job
    signals = welded(name, {"seed": index + 1, **factors}, event).signals
    began = time.process_time()
    fit = identify(prepare(signals, Actuators().lag_s).segments)
    seconds = time.process_time() - began
    excursions = [
        float(abs(signals.truth.depth_mm - DEPTH_MM).max()),
        float(abs(signals.truth.temperature_c - TEMPERATURE_C).max()),
    ]
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return Run(*errors_of(fit, factors), seconds, disturbances(fit), excursions, memory_mb)


def errors_of(fit, factors):
    """Relative error and standard deviation of every parameter."""
    model = {
        name.removeprefix("factors."): factor
        for name, factor in factors.items()
        if name.startswith("factors.")
    }
    truth = nominal().scaled(**model)
    errors = {
        name: getattr(fit.parameters, name) / getattr(truth, name) - 1.0 for name in fit.free
    }
    return errors, {name: fit.std[name] / getattr(fit.parameters, name) for name in fit.free}


def estimates_of(runs):
    """A row for each parameter of each run, and its rows by parameter.

    The error also in standard deviations.
    """
    table = pd.DataFrame(
        [
            {"name": name, "error": abs(error), "deviations": abs(error) / run.deviations[name]}
            for run in runs
            for name, error in run.errors.items()
        ]
    )
    return table, dict(list(table.groupby("name", sort=False)))


def percent(flags):
    """Share of those that are true."""
    return 100.0 * sum(map(bool, flags)) / len(flags)


def coverage_of(every, by_name):
    """Shares of the true values in the intervals, of each parameter and of all."""
    figures = {
        f"{name}_inside_95_percent": percent(own.deviations <= _95)
        for name, own in by_name.items()
    }
    return figures | {"inside_95_percent": percent(every.deviations <= _95)}


def of_undisturbed(drawn):
    """Errors and coverage of all intervals on undisturbed welds of five minutes."""
    jobs = [(i, factors, None, EXPERIMENT) for i, factors in enumerate(drawn)]
    runs = _benchmark.each(identified, jobs, "undisturbed:")
    every, by_name = estimates_of(runs)
    result = {"plants": len(runs), "cpus": os.cpu_count(), **coverage_of(every, by_name)}
    for name, own in by_name.items():
        in_s = name == "dead_time_s"
        scale, unit = (nominal().dead_time_s, "s") if in_s else (100.0, "percent")
        result |= {
            f"{name}_median_{unit}": scale * own.error.median(),
            f"{name}_p95_{unit}": scale * own.error.quantile(0.95, "lower"),
            f"{name}_told": len(own),
        }
    depth_mm, temperature_c = zip(*(run.excursions for run in runs), strict=True)
    return result | {
        "cpu_s_median": statistics.median(run.seconds for run in runs),
        "cpu_s_largest": max(run.seconds for run in runs),
        "depth_excursion_mm_largest": max(depth_mm),
        "temperature_excursion_c_largest": max(temperature_c),
        "false_alarms": sum(bool(run.remarks) for run in runs),
    }


def of_disturbed(drawn):
    """How many disturbed welds bias a parameter, and how many without a word."""
    events = [disturbance(index) for index in range(len(drawn))]
    jobs = [(i, drawn[i], events[i], EXPERIMENT) for i in range(len(drawn))]
    rows = []
    runs = _benchmark.each(identified, jobs, "disturbed:")
    for run, event in zip(runs, events, strict=True):
        off = {
            name: abs(run.errors[name]) / run.deviations[name]
            for name in AIMS
            if name in run.errors
        }
        worst, largest = max(off, key=off.get), max(abs(run.errors[name]) for name in off)
        rows.append({"biased": off[worst] > BIASED, "largest": largest, "silent": not run.remarks})
        print(
            f"{off[worst]:5.1f} deviations, {100 * largest:5.1f} %, "
            f"{worst:<22} {event} {run.remarks}",
            file=sys.stderr,
        )
    welds = pd.DataFrame(rows)
    return {
        "disturbed_welds": len(welds),
        "disturbed_told": int((~welds.silent).sum()),
        "disturbed_biased_percent": percent(welds.biased),
        "disturbed_biased_and_not_told_percent": percent(welds.biased & welds.silent),
        "disturbed_off_by_10_percent_and_not_told_percent": percent(
            (welds.largest > GROSS) & welds.silent
        ),
        "disturbed_largest_error_median_percent": 100.0 * welds.largest.median(),
    }


def of_whole_welds(drawn):
    """Coverage of all intervals and errors of the depth gain on welds of 45 minutes."""
    jobs = [(i, factors, None, WHOLE_WELD) for i, factors in enumerate(drawn)]
    runs = _benchmark.each(identified, jobs, "whole weld:")
    every, by_name = estimates_of(runs)
    figures = coverage_of(every, by_name) | {
        "welds": len(runs),
        "values": len(every),
        "largest_deviations": every.deviations.max(),
        "beyond_3_deviations": int((every.deviations > BIASED).sum()),
        "depth_gain_median_percent": 100.0 * by_name["depth_gain_mm_per_kn_s"].error.median(),
        "cpu_s_median": statistics.median(run.seconds for run in runs),
        "cpu_s_largest": max(run.seconds for run in runs),
        "memory_mb_largest": max(run.memory_mb for run in runs),
    }
    return {f"whole_{key}": value for key, value in figures.items()}


def of_foreign(drawn):
    """Canisters on which the identified model predicts better than the paper's; ratios of RMS."""
    runs = _benchmark.each(foreign, range(len(drawn)), "canister:")
    figures = {"canisters": len(runs), **compared(runs)}
    return {f"foreign_{key}": value for key, value in figures.items()}


def compared(runs):
    """How often predictions beat those of the paper's model, and ratios of errors, by kind."""
    figures = {}
    for key, ratios in pd.DataFrame(runs).items():
        figures |= {
            f"{key}_better_percent": percent(ratios < 1.0),
            f"{key}_ratio_median": ratios.median(),
            f"{key}_ratio_largest": ratios.max(),
        }
    return figures


def foreign(index):
    """Errors of predictions of another weld on a canister of the campaign.

    Identified model over the paper's.
    """
    changes = load("canisters").parameters(index)
    heat = content_of(text_of("identify_heat"))
    other = content_of(text_of(EXPERIMENT)) | {"plant": heat["plant"]}
    welds = [
        fsw.simulate(content, "decentral:conservative", changes=changes | more)
        for content, more in ((heat, {"plant.seed": index + 1}), (other, {"plant.noise": False}))
    ]
    lag_s = Actuators().lag_s
    taught, judged = (prepare(weld.signals, lag_s).segments for weld in welds)
    free, steady = (
        over_the_papers(judged, identify(taught, steady=how), SETTLED_TICKS)
        for how in (False, True)
    )
    return free | {f"steady_{key}": ratio for key, ratio in steady.items()}


def over_the_papers(judged, fit, settled):
    """Errors of predictions by an identified model over those of the paper's model."""
    own = prediction_errors(judged, fit.shown, settled, fit.known_lag_s)
    papers = prediction_errors(judged, nominal(), settled)
    return {key: own[key] / papers[key] for key in own}


def of_sensors(drawn):
    """Coverage of intervals with other sensors; errors of predictions over the paper's model's."""
    result = {}
    for kind in KINDS:
        jobs = [(i, factors, kind) for i, factors in enumerate(drawn)]
        runs = _benchmark.each(sensed, jobs, f"{kind}:")
        every, by_name = estimates_of(runs)
        correlations_s = zip(*(run.correlation_s for run in runs), strict=True)
        figures = coverage_of(every, by_name) | {
            "beyond_3_deviations_percent": percent(every.deviations > BIASED),
            "told": sum(bool(run.remarks) for run in runs),
            "not_white": sum(run.not_white for run in runs),
            "cpu_s_median": statistics.median(run.seconds for run in runs),
            "plants": len(runs),
            **lags_of(runs, SENSING.get(kind, {}).get("sensors.temperature_lag_s", 0.0)),
            **compared([run.ratios for run in runs]),
        }
        figures |= {
            f"{name}_correlation_s_median": statistics.median(own)
            for name, own in zip(OUTPUTS, correlations_s, strict=True)
        }
        figures |= {
            f"{name}_median_percent": 100.0 * by_name[name].error.median()
            for name in AIMS
            if name in by_name
        }
        result |= {f"sensors {kind}: {key}": value for key, value in figures.items()}
    return result


def lags_of(runs, true_lag_s):
    """Lags of the thermocouple where the data show one."""
    lags = [run.lag_s for run in runs if run.lag_s]
    if not lags:
        return {"lag_told": 0}
    return {
        "lag_told": len(lags),
        "lag_s_median": statistics.median(lag_s for lag_s, _ in lags),
        "lag_std_s_median": statistics.median(std for _, std in lags),
        "lag_inside_95_percent": percent(
            [abs(lag_s - true_lag_s) / std <= _95 for lag_s, std in lags]
        ),
    }


def sensed(job):
    """Identify a plant with such sensors."""
    index, factors, kind = job
    lag_s = Actuators().lag_s
    sensors, event = SENSING.get(kind, {}), None
    if kind == DISTURBED:
        sensors, event = SENSING["correlated 1 s"], disturbance(index)
    noise = {"noise": False} if kind in MIXED else {}
    weld = welded(EXPERIMENT, {"seed": index + 1, **factors, **sensors, **noise}, event)
    taught = prepare(weld.signals, lag_s).segments
    if kind in MIXED:
        taught = [noisy(segment, MIXED[kind], index) for segment in taught]
    began = time.process_time()
    fit = identify(taught)
    seconds = time.process_time() - began
    judge = welded(JUDGE, {"noise": False, **factors, **sensors})
    judged = prepare(judge.signals, lag_s).segments
    return Run(
        *errors_of(fit, factors),
        seconds,
        disturbances(fit),
        ratios=over_the_papers(judged, fit, 0),
        not_white=bool(Summary(kind, fit).coloured),
        lag_s=fit.lag_s,
        correlation_s=list(map(float, fit.correlation_s)),
    )


def prediction_errors(segments, model, settled, lag_s=0.0):
    """RMS error of a model one tick and 30 s ahead.

    Of the change of an output, by the inputs and the other outputs.
    """
    errors = {}
    for output, name in enumerate(OUTPUTS):
        for ticks in (1, 300):
            wrong = []
            for segment in segments:
                # the temperature is that which is shown; the depth follows the tool's
                ahead_s = lag_s if output == DEPTH else 0.0
                response = respond(output, model, segment, measured(segment, model), ahead_s)
                left = (segment.measured[:, output] - response.factor * response.course)[settled:]
                wrong.append(left[ticks:] - left[:-ticks])
            wrong = np.concatenate(wrong)
            errors[f"{name}_{ticks}_ticks"] = float(np.sqrt(np.nanmean(wrong**2)))
    return errors


#: what is measured: full and quick number of plants, and the function
PARTS = {
    "undisturbed": ((100, 8), of_undisturbed),
    "disturbed": ((60, 8), of_disturbed),
    "whole": ((40, 2), of_whole_welds),
    "foreign": ((12, 2), of_foreign),
    "sensors": ((12, 2), of_sensors),
}


def measure(quick, part):
    """Figures of the parts."""
    result = {}
    for name in part:
        counts, figures_of = PARTS[name]
        result |= figures_of(random_factors(counts[quick], SPANS))
    return result, {}


if __name__ == "__main__":
    part = {"nargs": "+", "choices": PARTS, "default": PARTS, "help": "only these"}
    aims = {
        f"{name}_median_{'s' if name == 'dead_time_s' else 'percent'}": aim
        for name, aim in AIMS.items()
    }
    quick = "8 plants instead of 100 or 60, 2 instead of 12"
    _benchmark.run(__doc__, quick, measure, options={"--part": part}, aims=aims, sign="<=")
