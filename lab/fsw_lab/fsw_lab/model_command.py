"""``fsw.py model``: the bare process in open loop, without drives, sensors and noise."""

from __future__ import annotations

import argparse
from pathlib import Path

from fsw.command import FORCE, command, file, option, picture
from fsw.errors import CommandError
from fsw.outputs import check_new
from fsw_analysis.export import write_table
from fsw_control.schema.files import replacing
from fsw_lab import input_steps
from fsw_model import ModelParameters, ProcessModel


@command(
    "model",
    "simulate the process alone, in open loop from a file of input steps",
    option(
        "--events",
        required=True,
        metavar="FILE",
        help=f"YAML file, or one of {', '.join(input_steps.shipped())} (the paper's)",
    ),
    file("--csv", "table to write", required=True),
    picture("--figure", "also plot it like the paper's Figs. 4 and 5"),
    file("--model", "model parameters (YAML) instead of the paper's"),
    FORCE,
    description="Simulate the process alone (no drives, no sensors, no noise) "
    "in open loop from the operating "
    "point and write its trajectories as CSV, a row every 0.1 s. "
    "The file lists steps {at_s, force_kn, speed_rpm}, "
    "or is a mapping with events: and duration_s: (default: 30 s after the last event). "
    "Values are absolute and in force from at_s, a multiple of 0.1 s; "
    "an omitted one keeps its value.",
)
def model(arguments: argparse.Namespace) -> int:
    files = [arguments.csv] if arguments.figure is None else [arguments.csv, arguments.figure]
    if arguments.csv == arguments.figure:
        raise CommandError(f"model: --csv and --figure are both {arguments.csv}; give two files")
    check_new(files, arguments.force)
    steps = input_steps.read(arguments.events)
    parameters = (
        ModelParameters.from_file(arguments.model) if arguments.model is not None else None
    )
    course = input_steps.simulate(steps, ProcessModel(parameters))
    with replacing(arguments.csv) as table:
        write_table(course, table)
        if arguments.figure is not None:
            from fsw_analysis.figures import draw_open_loop  # matplotlib takes a second to import

            title = f"Process in open loop: {Path(arguments.events).name}"
            draw_open_loop(
                course | {"process_power_kw": course["power_kw"]}, title, arguments.figure
            )
    last_s = course["time_s"][-1]
    print(
        f"{len(course['time_s'])} rows, 0 to {last_s:g} s, written to {', '.join(map(str, files))}"
    )
    return 0
