"""``fsw.py monitor``: the watch within a weld, run over its bag."""

from __future__ import annotations

import argparse
from math import isfinite
from pathlib import Path

from fsw.bags import DAMAGED_TOO, read_weld
from fsw.command import FORCE, command, file, option, picture
from fsw.console import ProgressBar, check_new, print_table, write_json
from fsw_hmi.alarms import ACTIONS
from fsw_model import ModelParameters
from fsw_quality.likelihood import covariance_from
from fsw_quality.monitor import PROCESSES, Monitor
from fsw_quality.monitor_figure import draw
from fsw_quality.monitor_run import Interval, Watched, process_of, watch


@command(
    "monitor",
    "alarms of the monitor on a recorded weld, with cause, advice and sizes of faults",
    option("bag", type=Path, help=DAMAGED_TOO),
    option(
        "--process",
        choices=PROCESSES,
        help="what the model knows (default: that of the bag's scenario)",
    ),
    file("--model", "YAML file of the model's parameters (default: the paper's)"),
    file(
        "--covariance",
        "the parameters' covariance, of identify --covariance (default: within 10 %%)",
    ),
    picture("--figure", "disturbances, likelihood, alarms and estimated sizes"),
    file("--json", "write alarms, estimates and gains as JSON"),
    FORCE,
    description="Run the monitor over the bag of a weld, as fsw_monitor does in the weld.",
)
def monitor(arguments: argparse.Namespace) -> int:
    check_new([arguments.figure, arguments.json], arguments.force)
    signals = read_weld(arguments.bag)
    process = arguments.process or process_of(signals)
    model = ModelParameters.from_file(arguments.model) if arguments.model else None
    with ProgressBar("monitor") as bar:
        watched = watch(
            Monitor(process, model, covariance_from(arguments.covariance or "")), signals, bar
        )
    _print(watched, process)
    if arguments.figure is not None:
        arguments.figure.parent.mkdir(parents=True, exist_ok=True)
        draw(watched, f"Monitor on {arguments.bag}", arguments.figure)
        print(f"written: {arguments.figure}")
    gains = {
        name: {"gain": gain, "standard_error": error}
        for name, (gain, error) in watched.gains.items()
    }
    intervals = {"alarms": watched.alarms, "others": watched.others}
    findings = {name: [_json(interval) for interval in some] for name, some in intervals.items()}
    estimates = {estimate.cause.word: estimate.numbers for estimate in watched.estimates[-1]}
    content = {"process": process, **findings, "estimates": estimates, "gains": gains}
    write_json(arguments.json, content)
    return 0


def _json(interval: Interval) -> dict[str, object]:
    finding = interval.finding
    names = ("size", "standard_error", "log_likelihood")
    numbers = zip(names, (*finding.scaled, finding.log_likelihood), strict=True)
    return {
        "begin_s": interval.begin_s,
        "end_s": interval.end_s,
        "cause": finding.cause.word,
        "others": [other.word for other in finding.others],
        **{name: value if isfinite(value) else None for name, value in numbers},
        "unit": finding.unit,
    }


def _print(watched: Watched, process: str) -> None:
    for title, intervals in (("alarms", watched.alarms), ("no alarms, but shown", watched.others)):
        print(f"{title}: {len(intervals) or 'none'} in {len(watched.time_s)} s, process {process}")
        if intervals:
            rows = [
                (f"{a.begin_s:.0f}", f"{a.end_s:.0f}", a.finding.text, ACTIONS[a.finding.action])
                for a in intervals
            ]
            print_table(rows, ("from [s]", "to [s]", "cause", "advice"))
    rows = [
        (estimate.name, estimate.text, "x" if estimate.is_distinct else "", estimate.alarm_text)
        for estimate in watched.estimates[-1]
    ]
    print("estimated at the end, each as if alone for a minute; no claim that it is there:")
    print_table(rows, ("fault", "size ± 2 standard errors", "not 0", "alarm in a minute from"))
    print("gains of this weld relative to the model's, ± 2 standard errors:")
    for name, (gain, error) in watched.gains.items():
        print(f"{name}: {gain:.1%} ± {2.0 * error:.1%}")
