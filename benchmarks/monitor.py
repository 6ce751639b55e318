#!/usr/bin/env python3
"""The watch within a weld.

False alarms, detection delays and cost, on emulated welds without and with faults.

usage: monitor.py [--quick] [--json FILE] [--calibrate]

With ``--calibrate`` it computes the level of alarms instead, from other seeds. Nothing in the
monitor was set by those of the page. ``monitor_welds.py`` says how the plants are drawn.
"""

import time
from itertools import product
from statistics import NormalDist

import _benchmark
import numpy as np
import scipy
from monitor_welds import CASES, DURATION_S, FAULT_S, IDENTIFIED, PROCESSES, Case, identified, weld

from fsw_campaign.report import wilson
from fsw_control.weld import TICK_S
from fsw_quality.diagnosis import Estimate, WatchCause
from fsw_quality.likelihood import default_covariance
from fsw_quality.monitor import ALARM, LASTS_S, SMOOTHED_S, Monitor
from fsw_quality.monitor_run import watch

#: seeds of the welds without a fault, of each fault, and of one that an aim is for by its size
HEALTHY, FAULTY, AIMED = range(7050, 7100), range(2000, 2003), range(2000, 2006)
#: of the welds without a fault, those that are also watched by the model of their own machine
KNOWN = HEALTHY[:20]
#: seeds of whole welds of 45 minutes without a fault
LONG, LONG_S = range(7500, 7506), 2700.0
#: lengths of welds without a fault
HEALTHY_S = {"none": DURATION_S, "identified": DURATION_S, "long": LONG_S}
#: seeds of whole healthy welds that calibrate the level of alarms, and the share of such welds
#: that may exceed it
CALIBRATING, SHARE = range(5500, 5516), 0.01
#: not judged on a canister, whose heat is unknown
OF_HEAT = "heat gain +20 %", "dead time +1.5 s"
#: standard errors from which a clairvoyant, who makes one test in a weld, decides for the fault:
#: one false alarm in a hundred
NORMAL = NormalDist()
DECIDES = NORMAL.inv_cdf(0.99)
#: expected log likelihood ratio from which it finds the fault in one weld of two
CLAIRVOYANT = 0.5 * DECIDES**2
#: models by which the welds with an aim are watched
MODELS = "nominal", "identified"


def judged(task):
    """One weld, watched by one of ``MODELS``; its row."""
    process, case, seed, model = task
    signals, moved_s, controller = weld(process, seed, case, HEALTHY_S.get(case, DURATION_S))
    known = identified(process, seed) if model == "identified" else ()
    monitor, durations, expected = Monitor(process, *known), [], []
    step, begin_s, faulty = monitor.step, max(FAULT_S, moved_s or 0.0), case in CASES
    planted = CASES.get(case, Case(()))
    named_s, stale = None, True  # whether the alarm was there before the fault
    cause = None if planted.size is None else planted.cause

    def timed(sample):
        nonlocal named_s, stale
        began = time.thread_time()
        step(sample)
        durations.append(time.thread_time() - began)
        if cause and sample.time_s > begin_s + 0.5:
            information = monitor.process.information(cause, FAULT_S)
            expected.append(0.5 * planted.size**2 * information)
        present = any(
            cause.word in planted.causes
            for finding in monitor.findings
            if finding.alarm
            for cause in (finding.cause, *finding.others)
        )
        stale = present and (stale or sample.time_s < FAULT_S)
        if present and not stale and named_s is None:
            named_s = max(sample.time_s - begin_s, 0.0)

    monitor.step = timed
    watched = watch(monitor, signals)
    alarms = [(alarm.begin_s, alarm.finding.cause.word) for alarm in watched.alarms]
    sizes = {}  # of the fault when it has lasted for a minute and at the end, without one of all
    if cause and begin_s + LASTS_S < watched.time_s[-1]:
        at = int(np.searchsorted(watched.time_s, begin_s + LASTS_S))
        for name, estimates in (("minute", watched.estimates[at]), ("end", watched.estimates[-1])):
            sizes[name] = next(
                numbers(estimate) for estimate in estimates if estimate.cause == cause
            )
    elif not faulty:
        sizes = {estimate.cause.word: numbers(estimate) for estimate in watched.estimates[-1]}
    return {
        "process": process,
        "case": case,
        "seed": seed,
        "model": model,
        "excited": not planted.shown_by or moved_s is not None,
        "controller": controller,
        "false": [cause for at_s, cause in alarms if not faulty or at_s < FAULT_S],
        "named_s": named_s,
        "sizes": {name: size for name, size in sizes.items() if size},
        "possible_s": next(
            (TICK_S * tick for tick, ratio in enumerate(expected, 1) if ratio >= CLAIRVOYANT), None
        ),
        "expected": expected[: round(60.0 / TICK_S)][-1] if expected else None,
        "step_ms": {
            "mean": 1e3 * float(np.mean(durations)),
            "p99": 1e3 * float(np.percentile(durations, 99)),
        },
    }


def numbers(estimate: Estimate):
    """Size and standard error, as people read them; None of a fault that is not judged."""
    return None if estimate.reason else estimate.scaled[:2]


def largest(task):
    """Largest smoothed log likelihood ratio of any fault in a whole healthy weld."""
    process, seed = task
    signals, *_ = weld(process, seed, "none", LONG_S)
    return max(watch(Monitor(process), signals).ratios)


def level():
    """Level that the largest ratio of a weld exceeds in the share that is allowed.

    By a Gumbel distribution.

    It is the largest of all causes, onsets and times of a weld, so that the share is that of all
    of them together; maxima of many dependent values tend to such a distribution (Gumbel,
    Statistics of Extremes, 1958).
    """
    maxima = _benchmark.each(largest, product(PROCESSES, CALIBRATING), "welds:")
    fitted = scipy.stats.gumbel_r(*scipy.stats.gumbel_r.fit(maxima))
    return {
        "welds": len(maxima),
        "largest": max(maxima),
        "second_largest": sorted(maxima)[-2],
        "median": float(np.median(maxima)),
        "level": float(fitted.isf(SHARE)),
        "shipped": ALARM,
        "percent_at_shipped": 100.0 * float(fitted.sf(ALARM)),
        "welds_over_shipped": sum(ratio >= ALARM for ratio in maxima),
    }


def summary(rows, process, case, model):
    """Figures of the welds of a case in which a set-point moves that shows the fault."""
    of = process, case, model, True
    own = [
        row
        for row in rows
        if tuple(row[name] for name in ("process", "case", "model", "excited")) == of
    ]
    named = [row["named_s"] for row in own if row["named_s"] is not None]
    possible = [row["possible_s"] for row in own]
    late_s = np.median([np.inf if at_s is None else at_s for at_s in possible] or [np.inf])
    sized = bool(own) and all(row["expected"] is not None for row in own)
    aim_s = CASES[case].aim_s if process == "paper" or case not in OF_HEAT else None
    return {
        "welds": len(own),
        "named": len(named),
        "median_s": float(np.median(named)) if named else None,
        "worst_s": max(named, default=None),
        "aim_s": aim_s,
        "in_time": None if aim_s is None else sum(delay_s <= aim_s for delay_s in named),
        "possible": sum(at_s is not None for at_s in possible) if sized else None,
        "possible_s": float(late_s) if np.isfinite(late_s) else None,
        "expected": float(np.median([row["expected"] for row in own])) if sized else None,
        "possible_percent": 100.0
        * float(np.mean([NORMAL.cdf((2.0 * row["expected"]) ** 0.5 - DECIDES) for row in own]))
        if sized
        else None,
        **estimated(own, case),
    }


def estimated(own, case):
    """In how many welds the band of a fault's size has the true one, and excludes 0.

    The band, all at both times.
    """
    figures, planted = {}, CASES[case]
    size = Estimate(planted.cause, planted.size).scaled[0] if planted.size else 0.0
    for name in ("minute", "end"):
        sizes = [row["sizes"][name] for row in own if name in row["sizes"]]
        figures |= {
            f"{name}_sized": len(sizes),
            f"{name}_contains": sum(abs(shown - size) <= 2.0 * error for shown, error in sizes),
            f"{name}_not_0": sum(abs(shown) > 2.0 * error for shown, error in sizes),
            f"{name}_size": float(np.median([shown for shown, _ in sizes])) if sizes else None,
            f"{name}_band": 2.0 * float(np.median([error for _, error in sizes]))
            if sizes
            else None,
        }
    return figures


def without_fault(rows, process):
    """Of welds without a fault.

    In how many the band of each cause contains 0 at the end, and the band; and of all causes.
    """
    free = [row["sizes"] for row in rows if row["process"] == process and row["case"] in HEALTHY_S]
    figures = {}
    for cause in dict.fromkeys(cause for sizes in free for cause in sizes):
        sizes = [estimates[cause] for estimates in free]
        contain = sum(abs(size) <= 2.0 * error for size, error in sizes)
        low, high = wilson(contain, len(sizes))
        figures[cause] = {
            "welds": len(sizes),
            "contain_0": contain,
            "percent": [100.0 * contain / len(sizes), 100.0 * low, 100.0 * high],
            "band": 2.0 * float(np.median([error for _, error in sizes])),
            "unit": Estimate(WatchCause[cause.upper()]).unit,
        }
    whole = sum(all(abs(s) <= 2.0 * e for s, e in sizes.values()) for sizes in free)
    return figures | {"all causes": {"welds": len(free), "contain_0": whole}}


def overall(rows):
    """False alarms and cost."""
    figures = {"step_mean_ms": float(np.median([row["step_ms"]["mean"] for row in rows]))}
    figures["step_p99_ms"] = float(np.median([row["step_ms"]["p99"] for row in rows]))
    faulty = [row for row in rows if row["case"] in CASES]
    figures |= {
        "fault_welds": len(faulty),
        "fault_welds_with_alarm_before": sum(bool(row["false"]) for row in faulty),
    }
    for process, case in product(PROCESSES, HEALTHY_S):
        free = [row for row in rows if row["process"] == process and row["case"] == case]
        bad = [row for row in free if row["false"]]
        causes = sorted({cause for row in bad for cause in row["false"]})
        of_case = {
            "welds": len(free),
            "under_nmpc": sum(row["controller"].startswith("nmpc") for row in free),
            "with_false_alarm": len(bad),
            "false_alarms": ", ".join(causes),
            "at_most_percent": 100.0 * wilson(len(bad), len(free))[1],
        }
        figures |= {f"{process}_{case}_{name}": value for name, value in of_case.items()}
    return figures


def planned(quick):
    """Process, case, seed and model of each weld."""
    healthy, known = (HEALTHY[1:3], KNOWN[1:2]) if quick else (HEALTHY, KNOWN)
    tasks = [] if quick else [*product(PROCESSES, ("long",), LONG, MODELS[:1])]
    for case, planted in CASES.items():
        sized = None not in (planted.aim_s, planted.size)
        seeds = FAULTY[1:2] if quick else AIMED if sized else FAULTY
        # one weld in four is left alone: no set-point shows its gains
        seeds = [seed for seed in seeds if seed % 4 or not planted.shown_by]
        tasks += product(PROCESSES, (case,), seeds, MODELS if sized else MODELS[:1])
    tasks += product(PROCESSES, ("none",), healthy, MODELS[:1])
    tasks += product(PROCESSES, ("identified",), known, MODELS[1:])
    return tasks


def measure(quick, calibrate):
    """Figures, and the content of the page; or the level of alarms."""
    if calibrate:
        return level(), {}
    tasks = planned(quick)
    return content_of(_benchmark.each(judged, tasks, "welds:"))


def content_of(rows):
    """Figures, and the content of the page."""
    tables = {
        process: {case: summary(rows, process, case, "nominal") for case in CASES}
        for process in PROCESSES
    }
    aims = {
        (process, case, model): row
        for process, case, model in product(PROCESSES, CASES, MODELS)
        if (row := summary(rows, process, case, model))["aim_s"] is not None and row["welds"]
    }
    figures = overall(rows)
    sizes = {process: without_fault(rows, process) for process in PROCESSES}
    identified_aims = {
        (process, f"{case}, identified"): row
        for (process, case, model), row in aims.items()
        if model == "identified"
    }
    flat = _benchmark.flat(tables) | _benchmark.flat(identified_aims) | _benchmark.flat(sizes)
    return figures | flat, {
        "figures": figures,
        "tables": tables,
        "aims": aims,
        "identified": IDENTIFIED,
        "of_heat": OF_HEAT,
        "sizes": sizes,
        "level": ALARM,
        "lasts_s": LASTS_S,
        "smoothed_s": SMOOTHED_S,
        "unidentified": default_covariance()[0, 0] ** 0.5,
        "calibrating": len(PROCESSES) * len(CALIBRATING),
    }


if __name__ == "__main__":
    calibrate = {"action": "store_true", "help": "compute the level of alarms; no page"}
    _benchmark.run(__doc__, "few welds, no page", measure, "monitor", {"--calibrate": calibrate})
