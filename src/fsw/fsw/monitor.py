"""``fsw.py monitor``: the watch within a weld, run over its bag."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from fsw.bags import DAMAGED_TOO, read_weld
from fsw.errors import CommandError
from fsw.options import add_file, add_force
from fsw.outputs import check_new, write_json
from fsw.progress import ProgressBar
from fsw_model import ModelParameters
from fsw_quality.diagnosis import load_limits
from fsw_quality.monitor import PROCESSES, Monitor
from fsw_quality.monitor_run import Watched, process_of, watch


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    parser = commands.add_parser(
        "monitor",
        help="warnings of the monitor on a recorded weld: cause, confidence, advice",
        description="Run the monitor over the bag of a weld, as the node fsw_monitor does while it is welded.",
    )
    parser.add_argument("bag", type=Path, help=DAMAGED_TOO)
    parser.add_argument("--process", choices=PROCESSES, help="whose limits hold (default: that of the bag's scenario)")
    add_file(parser, "--model", "YAML file of the model's parameters (default: the paper's)")
    add_file(parser, "--figure", "PNG file of residuals, figures and alarms")
    add_file(parser, "--json", "write alarms, gains and largest figures as JSON")
    add_force(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    check_new([arguments.figure, arguments.json], arguments.force)
    signals = read_weld(arguments.bag)
    process = arguments.process or process_of(signals)
    model = ModelParameters.from_file(arguments.model) if arguments.model else None
    with ProgressBar("monitor") as bar:
        watched = watch(Monitor(process, model), signals, bar)
    if not watched.time_s:
        raise CommandError(f"{arguments.bag}: no second with depth, torque, temperature, force and speed to watch")
    _print(watched, process)
    if arguments.figure is not None:
        from fsw_quality.monitor_figure import draw  # matplotlib takes a second to import

        try:
            arguments.figure.parent.mkdir(parents=True, exist_ok=True)
            draw(watched, load_limits()[process], f"{arguments.bag} ({process})", arguments.figure)
        except OSError as error:
            raise CommandError(f"cannot write {arguments.figure}: {error.strerror}") from None
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
            "largest": watched.largest(),
        },
    )
    return 0


def _print(watched: Watched, process: str) -> None:
    console = Console()
    if watched.alarms:
        table = Table("from [s]", "to [s]", "sure", "cause", "advice", title=f"alarms, limits of process {process}")
        for one in watched.alarms:
            told = one.finding
            table.add_row(f"{one.begin_s:.0f}", f"{one.end_s:.0f}", f"{told.confidence:.0%}", told.cause, told.advice)
        console.print(table)
    else:
        print(f"no alarm, limits of process {process}")
    for name, (gain, error) in watched.gains.items():
        interval = f" ± {2.0 * error:.1%}" if isfinite(error) else ""
        print(f"gain of {name}: {gain:.1%}{interval} of the model's")
