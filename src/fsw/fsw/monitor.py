"""``fsw.py monitor``: the watch within a weld, run over its bag."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from math import isfinite
from pathlib import Path

from fsw.bags import DAMAGED_TOO, read_weld
from fsw.command import FORCE, command, file, option
from fsw.console import print_table
from fsw.outputs import check_new, write_json
from fsw.progress import ProgressBar
from fsw_model import ModelParameters
from fsw_quality.diagnosis import load_limits
from fsw_quality.monitor import PROCESSES, Monitor
from fsw_quality.monitor_figure import draw
from fsw_quality.monitor_run import Watched, process_of, watch


@command(
    "monitor",
    "warnings of the monitor on a recorded weld: cause, confidence, advice",
    option("bag", type=Path, help=DAMAGED_TOO),
    option("--process", choices=PROCESSES, help="whose limits hold (default: that of the bag's scenario)"),
    file("--model", "YAML file of the model's parameters (default: the paper's)"),
    file("--figure", "PNG file of residuals, figures and alarms"),
    file("--json", "write alarms, gains and largest figures as JSON"),
    FORCE,
    description="Run the monitor over the bag of a weld, as the node fsw_monitor does while it is welded.",
)
def monitor(arguments: argparse.Namespace) -> int:
    check_new([arguments.figure, arguments.json], arguments.force)
    signals = read_weld(arguments.bag)
    process = arguments.process or process_of(signals)
    model = ModelParameters.from_file(arguments.model) if arguments.model else None
    with ProgressBar("monitor") as bar:
        watched = watch(Monitor(process, model), signals, bar)
    _print(watched, process)
    if arguments.figure is not None:
        limits, title = load_limits()[process], f"{arguments.bag} ({process})"
        arguments.figure.parent.mkdir(parents=True, exist_ok=True)
        draw(watched, limits, title, arguments.figure)
        print(f"written: {arguments.figure}")
    write_json(
        arguments.json,
        {
            "process": process,
            "alarms": [asdict(one) for one in watched.alarms],
            "gains": {
                name: {"gain": gain, "standard_error": error if isfinite(error) else None}
                for name, (gain, error) in watched.gains.items()
            },
            "noise_correlated_over_s": watched.correlations_s,
            "largest": watched.largest(),
        },
    )
    return 0


def _print(watched: Watched, process: str) -> None:
    alarms, seconds = "alarms" if watched.alarms else "no alarm", len(watched.time_s)
    print(f"{alarms} in the {seconds} s with all that is watched, limits of process {process}")
    if watched.alarms:
        found = [(one, one.finding) for one in watched.alarms]
        rows = [(f"{a.begin_s:.0f}", f"{a.end_s:.0f}", f.cause, f"{f.confidence:.0%}", f.advice) for a, f in found]
        print_table(rows, ("from [s]", "to [s]", "cause", "confidence in this cause", "advice"))
    for name, time_s in watched.correlations_s.items():
        print(f"noise of {name}: correlated over about {time_s:.1f} s; what it makes unsure is judged less sharply")
    for name, (gain, error) in watched.gains.items():
        interval = f" ± {2.0 * error:.1%}" if isfinite(error) else ""
        print(f"gain of {name}: {gain:.1%}{interval} of the model's")
