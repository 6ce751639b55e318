"""``fsw.py simulate``: scenarios offline."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from fsw_analysis import kpi_table
from fsw_experiment.cli.errors import CommandError
from fsw_experiment.cli.progress import ProgressBar
from fsw_experiment.scenario_file import load, shipped


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    parser = commands.add_parser(
        "simulate",
        help="run a scenario offline; writes signals, figures of merit and figures",
        description="Run a scenario in this process, without middleware: plant emulator and controllers at full speed.",
    )
    parser.add_argument("scenario", nargs="?", help=f"YAML file, or one of {', '.join(shipped())}")
    parser.add_argument(
        "--controller",
        action="append",
        metavar="NAME[:TUNING]",
        help="run with this controller instead of the scenario's; several times: compare, e.g. decentral:tight",
    )
    parser.add_argument("--no-noise", action="store_true", help="sensors without noise and quantisation")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace a value of the scenario, e.g. plant.seed=3",
    )
    parser.add_argument("--out", type=Path, help="folder for the results (default out/<date>_<scenario>)")
    parser.add_argument("--no-figures", action="store_true", help="figures of merit only")
    parser.add_argument("--list", action="store_true", help="list the shipped scenarios and end")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Carry the command out; returns the exit code."""
    if arguments.list or arguments.scenario is None:
        if not arguments.list:
            raise CommandError(f"simulate: which scenario? One of {', '.join(shipped())}, or a YAML file")
        for name in shipped():
            print(f"{name:<24} {' '.join(load(name).description.split())}")
        return 0
    from fsw_analysis import kpi
    from fsw_analysis.export import export_weld
    from fsw_analysis.figures import Run, draw
    from fsw_experiment.closed_loop import ClosedLoop
    from fsw_experiment.controllers import make

    overrides = [*arguments.set, *(["plant.noise=false"] if arguments.no_noise else [])]
    scenario = load(arguments.scenario, overrides)
    labels: list[str] = [scenario.controller]
    if arguments.controller:
        if scenario.open_loop:
            raise CommandError(f"simulate: {scenario.name} is an open-loop scenario; it takes no --controller")
        labels = list(dict.fromkeys(arguments.controller))
    loops: dict[str, ClosedLoop] = {}
    for label in labels:
        name = label.partition(":")[0]
        chosen = scenario if scenario.open_loop else load(arguments.scenario, [*overrides, f"controller={name}"])
        controllers = {} if scenario.open_loop else {name: make(label)}
        for other in chosen.controllers:
            if other not in controllers:
                controllers[other] = make(other)
        if scenario.open_loop:
            label = "open loop"
        elif len(labels) == 1 and len(controllers) > 1:
            label = " and ".join(controllers)
        loops[label] = ClosedLoop(chosen, controllers)
    folder = new_folder(arguments.out, scenario.name)
    runs: list[Run] = []
    for title, loop in loops.items():
        bar = ProgressBar(f"{scenario.name}, {title}")
        runs.append(Run(title, loop.run(bar)))
        bar.done()
        export_weld(runs[-1].signals, folder / f"signals_{title.replace(':', '_').replace(' ', '_')}.csv")
    figures_of_merit = [kpi.compute(one.signals, one.label) for one in runs]
    paths = kpi_table.write(figures_of_merit, folder)
    if not arguments.no_figures:
        paths += draw(runs, scenario.figures, folder)
    print(kpi_table.text(figures_of_merit), end="")
    print(f"in {folder}: {', '.join(path.name for path in sorted(folder.iterdir()))}")
    return 0


def new_folder(wanted: Path | None, name: str) -> Path:
    """Make a folder for results.

    Raises
    ------
    CommandError
        When it exists already and is not empty, or cannot be made.
    """
    folder = wanted or Path("out") / f"{time.strftime('%Y%m%d-%H%M%S')}_{name}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise CommandError(f"folder {folder} exists and is not empty; nothing is overwritten, choose another --out")
    except OSError as error:
        raise CommandError(f"cannot make folder {folder}: {error.strerror}") from None
    return folder
