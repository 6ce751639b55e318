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

import json
import os
import resource
import statistics
import sys
import time

import _benchmark
import numpy as np
import yaml
from identification_welds import MIXED, disturbance, noisy, welded

from controller_comparison.processes import RANDOM, SENSING, random_factors
from fsw_campaign.definition import load
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_identification.estimation import identify
from fsw_identification.problem import measured
from fsw_identification.simulation import DEPTH, OUTPUTS, respond
from fsw_identification.summary import Summary, disturbances
from fsw_identification.weld_data import prepare
from fsw_model import nominal
from fsw_plant.parameters import Actuators
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.scenario_file import content_of, parse, text_of
from fsw_tuning.standard_runs import on_all_cores

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
KINDS = (*SENSING, *MIXED, DISTURBED)


def one(job):
    """Weld and identify one plant.

    Returns relative error and standard deviation of every parameter, seconds, excursions, remarks
    about disturbances, largest memory of this process so far [MB].
    """
    index, factors, event, name = job
    signals = welded(name, {"seed": index + 1, **factors}, event)
    began = time.process_time()
    fit = identify(prepare(signals, Actuators().lag_s).segments)
    seconds = time.process_time() - began
    moved = (
        abs(signals.truth.depth_mm - DEPTH_MM).max(),
        abs(signals.truth.temperature_c - TEMPERATURE_C).max(),
    )
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return (
        *errors_of(fit, factors),
        seconds,
        [float(one) for one in moved],
        disturbances(fit),
        memory_mb,
    )


def errors_of(fit, factors):
    """Relative error and standard deviation of every parameter."""
    model = {
        name.removeprefix("factors."): of
        for name, of in factors.items()
        if name.startswith("factors.")
    }
    truth = nominal().scaled(**model)
    errors = {
        name: getattr(fit.parameters, name) / getattr(truth, name) - 1.0 for name in fit.free
    }
    return errors, {name: fit.std[name] / getattr(fit.parameters, name) for name in fit.free}


def results_of(name, function, jobs):
    """Results of all jobs, on all cores, with the progress."""
    return _benchmark.counted(on_all_cores(function, jobs), jobs, f"{name}:")


def of_undisturbed(drawn):
    """Errors and coverage of all intervals on undisturbed welds of five minutes."""
    runs = results_of(
        "undisturbed", one, [(i, factors, None, EXPERIMENT) for i, factors in enumerate(drawn)]
    )
    result = {"plants": len(runs), "cpus": os.cpu_count()}
    names = list(dict.fromkeys(name for errors, *_ in runs for name in errors))
    inside = []
    for name in names:
        told = [
            (errors[name], deviations[name]) for errors, deviations, *_ in runs if name in errors
        ]
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
    result["cpu_s_median"] = statistics.median(seconds for _, _, seconds, *_ in runs)
    result["cpu_s_largest"] = max(seconds for _, _, seconds, *_ in runs)
    result["depth_excursion_mm_largest"] = max(moved[0] for *_, moved, _, _ in runs)
    result["temperature_excursion_c_largest"] = max(moved[1] for *_, moved, _, _ in runs)
    result["false_alarms"] = sum(bool(told) for *_, told, _ in runs)
    return result


def of_disturbed(drawn):
    """How many disturbed welds bias a parameter, and how many without a word."""
    events = [disturbance(index) for index in range(len(drawn))]
    runs = results_of(
        "disturbed", one, [(i, drawn[i], events[i], EXPERIMENT) for i in range(len(drawn))]
    )
    biased, silent, gross, largest = 0, 0, 0, []
    for (errors, deviations, *_, told, _), event in zip(runs, events, strict=True):
        off = {name: abs(errors[name]) / deviations[name] for name in AIMS if name in errors}
        worst = max(off, key=off.get)
        largest.append(max(abs(errors[name]) for name in AIMS if name in errors))
        biased += off[worst] > BIASED
        silent += off[worst] > BIASED and not told
        gross += largest[-1] > GROSS and not told
        print(
            f"{off[worst]:5.1f} deviations, {100 * largest[-1]:5.1f} %, "
            f"{worst:<22} {event} {told}",
            file=sys.stderr,
        )
    return {
        "disturbed_welds": len(runs),
        "disturbed_told": sum(bool(told) for *_, told, _ in runs),
        "disturbed_biased_percent": 100.0 * biased / len(runs),
        "disturbed_biased_and_not_told_percent": 100.0 * silent / len(runs),
        "disturbed_off_by_10_percent_and_not_told_percent": 100.0 * gross / len(runs),
        "disturbed_largest_error_median_percent": 100.0 * statistics.median(largest),
    }


def deviations_of(runs):
    """By how many standard deviations each parameter is off in all runs that tell it."""
    off = {}
    for errors, deviations, *_ in runs:
        for name, error in errors.items():
            off.setdefault(name, []).append(abs(error) / deviations[name])
    return off


def of_whole_welds(drawn):
    """Coverage of all intervals and errors of the depth gain on welds of 45 minutes."""
    runs = results_of(
        "whole weld", one, [(i, factors, None, WHOLE_WELD) for i, factors in enumerate(drawn)]
    )
    off = deviations_of(runs)
    every = [one for values in off.values() for one in values]
    gain = [
        abs(errors["depth_gain_mm_per_kn_s"])
        for errors, *_ in runs
        if "depth_gain_mm_per_kn_s" in errors
    ]
    result = {
        f"whole_{name}_inside_95_percent": 100.0 * sum(one <= _95 for one in values) / len(values)
        for name, values in off.items()
    }
    return result | {
        "whole_welds": len(runs),
        "whole_values": len(every),
        "whole_inside_95_percent": 100.0 * sum(one <= _95 for one in every) / len(every),
        "whole_largest_deviations": max(every),
        "whole_beyond_3_deviations": sum(one > BIASED for one in every),
        "whole_depth_gain_median_percent": 100.0 * statistics.median(gain),
        "whole_cpu_s_median": statistics.median(seconds for _, _, seconds, *_ in runs),
        "whole_cpu_s_largest": max(seconds for _, _, seconds, *_ in runs),
        "whole_memory_mb_largest": max(memory_mb for *_, memory_mb in runs),
    }


def of_foreign(drawn):
    """Canisters on which the identified model predicts better than the paper's; ratios of RMS."""
    runs = results_of("canister", foreign, range(len(drawn)))
    result = {"foreign_canisters": len(runs)}
    for key in runs[0]:
        ratios = sorted(run[key] for run in runs)
        result[f"foreign_{key}_better_percent"] = percent(ratio < 1.0 for ratio in ratios)
        result[f"foreign_{key}_ratio_median"] = statistics.median(ratios)
        result[f"foreign_{key}_ratio_largest"] = ratios[-1]
    return result


def foreign(index):
    """Errors of predictions of another weld on a canister of the campaign.

    Identified model over the paper's.
    """
    overrides = [
        f"{name}={json.dumps(of)}" for name, of in load("canisters").parameters(index).items()
    ]
    heat = content_of(text_of("identify_heat"))
    other = content_of(text_of(EXPERIMENT)) | {"plant": heat["plant"]}
    welds = [
        ClosedLoop(
            parse(yaml.safe_dump(content), "foreign", [*overrides, *more]),
            {"decentral": make("decentral:conservative")},
        )
        for content, more in ((heat, [f"plant.seed={index + 1}"]), (other, ["plant.noise=false"]))
    ]
    lag_s = Actuators().lag_s
    taught, judged = (prepare(weld.run(), lag_s).segments for weld in welds)
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
        sensors = SENSING.get(kind, {})
        runs = results_of(kind, sensed, [(i, factors, kind) for i, factors in enumerate(drawn)])
        off = deviations_of(runs)
        every = [one for values in off.values() for one in values]
        found = {
            f"{name}_inside_95_percent": percent(one <= _95 for one in values)
            for name, values in off.items()
        }
        found["inside_95_percent"] = percent(one <= _95 for one in every)
        found["beyond_3_deviations_percent"] = percent(one > BIASED for one in every)
        found["told"] = sum(bool(told) for _, _, _, (told, _), *_ in runs)
        found["not_white"] = sum(not_white for _, _, _, (_, not_white), *_ in runs)
        found["cpu_s_median"] = statistics.median(seconds for *_, seconds in runs)
        lags = [lag_s for *_, lag_s, _, _ in runs if lag_s]
        found["lag_told"] = len(lags)
        if lags:
            off = [
                abs(lag_s - sensors.get("sensors.temperature_lag_s", 0.0)) / std
                for lag_s, std in lags
            ]
            found["lag_s_median"] = statistics.median(lag_s for lag_s, _ in lags)
            found["lag_std_s_median"] = statistics.median(std for _, std in lags)
            found["lag_inside_95_percent"] = percent(one <= _95 for one in off)
        for output, name in enumerate(OUTPUTS):
            found[f"{name}_correlation_s_median"] = statistics.median(
                over[output] for *_, over, _ in runs
            )
        for name in AIMS:
            if sizes := [abs(errors[name]) for errors, *_ in runs if name in errors]:
                found[f"{name}_median_percent"] = 100.0 * statistics.median(sizes)
        for key in runs[0][2]:
            ratios = [ratios[key] for _, _, ratios, *_ in runs]
            found[f"{key}_better_percent"] = percent(ratio < 1.0 for ratio in ratios)
            found[f"{key}_ratio_median"], found[f"{key}_ratio_largest"] = (
                statistics.median(ratios),
                max(ratios),
            )
        found["plants"] = len(runs)
        result |= {f"sensors {kind}: {key}": value for key, value in found.items()}
    return result


def percent(flags):
    """Share of those that are true."""
    return 100.0 * statistics.mean(map(float, flags))


def sensed(job):
    """Identify a plant with such sensors.

    Returns errors, standard deviations, ratios of errors of predictions, remarks about
    disturbances and whether one is about whiteness, lag and correlation times found, seconds.
    """
    index, factors, kind = job
    lag_s = Actuators().lag_s
    sensors, event = SENSING.get(kind, {}), None
    if kind == DISTURBED:
        sensors, event = SENSING["correlated 1 s"], disturbance(index)
    noise = {"noise": False} if kind in MIXED else {}
    taught = prepare(
        welded(EXPERIMENT, {"seed": index + 1, **factors, **sensors, **noise}, event), lag_s
    ).segments
    if kind in MIXED:
        taught = [noisy(segment, MIXED[kind], index) for segment in taught]
    began = time.process_time()
    fit = identify(taught)
    seconds = time.process_time() - began
    judged = prepare(welded(JUDGE, {"noise": False, **factors, **sensors}), lag_s).segments
    ratios = over_the_papers(judged, fit, 0)
    told = disturbances(fit), bool(Summary(kind, fit).coloured)
    return (
        *errors_of(fit, factors),
        ratios,
        told,
        fit.lag_s,
        list(map(float, fit.correlation_s)),
        seconds,
    )


def prediction_errors(segments, model, settled, lag_s=0.0):
    """RMS error of a model one tick and 30 s ahead.

    Of the change of an output, by the inputs and the other outputs.
    """
    found = {}
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
            found[f"{name}_{ticks}_ticks"] = float(np.sqrt(np.nanmean(wrong**2)))
    return found


#: what is measured: full and quick number of plants, and the function
PARTS = {
    "undisturbed": ((100, 8), of_undisturbed),
    "disturbed": ((60, 8), of_disturbed),
    "whole": ((40, 2), of_whole_welds),
    "foreign": ((12, 2), of_foreign),
    "sensors": ((12, 2), of_sensors),
}


def main():
    """Measure, print a table, write JSON."""
    options = _benchmark.parser(__doc__, "8 plants instead of 100 or 60, 2 instead of 12")
    options.add_argument("--part", nargs="+", choices=PARTS, default=PARTS, help="only these")
    arguments = options.parse_args()
    result = {}
    for part in arguments.part:
        counts, measure = PARTS[part]
        result |= measure(random_factors(counts[arguments.quick], SPANS))
    aims = {
        f"{name}_median_{'s' if name == 'dead_time_s' else 'percent'}": aim
        for name, aim in AIMS.items()
    }
    _benchmark.show(result, aims, "<=")
    _benchmark.save(result, arguments.json)


if __name__ == "__main__":
    main()
