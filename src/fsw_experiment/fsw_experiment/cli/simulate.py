"""``fsw.py simulate``: scenarios offline."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import yaml

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
    parser.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="CONTROLLER.NAME=VALUE",
        help="parameter of a controller's node; may be repeated, e.g. nmpc.tuning_file=tuning.yaml",
    )
    parser.add_argument(
        "--params-file",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="parameters of controllers' nodes, in ROS's format, e.g. of fsw.py tune; may be repeated",
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
    parameters: dict[str, dict[str, Any]] = {}
    for file in arguments.params_file:
        parameters.update(_parameters_of_nodes(file))
    for text in arguments.parameter:
        key, value = assignment("--parameter", text)
        name, _, inner = key.partition(".")
        parameters.setdefault(name, {})[inner] = value
    loops: dict[str, ClosedLoop] = {}
    used: set[str] = set()
    for label in labels:
        name = label.partition(":")[0]
        chosen = load(arguments.scenario, [*overrides, f"controller={name}"])
        variants = {other: label if other == name else other for other in chosen.controllers}
        controllers = {other: make(variant, parameters.get(other)) for other, variant in variants.items()}
        used |= controllers.keys()
        if chosen.open_loop:
            label = "open loop"
        elif len(labels) == 1 and len(controllers) > 1:
            label = " and ".join(controllers)
        loops[label] = ClosedLoop(chosen, controllers)
    unused = [name for name in parameters if name not in used]
    if unused:
        raise CommandError(f"simulate: --parameter is for {', '.join(unused)}, but {', '.join(used) or 'none'} run")
    folder = new_folder(arguments.out, scenario.name)
    runs: list[Run] = []
    for title, loop in loops.items():
        with ProgressBar(f"{scenario.name}, {title}") as bar:
            runs.append(Run(title, loop.run(bar)))
        export_weld(runs[-1].signals, folder / f"signals_{title.replace(':', '_').replace(' ', '_')}.csv")
    figures_of_merit = [kpi.compute(one.signals, one.label) for one in runs]
    paths = kpi_table.write(figures_of_merit, folder)
    if not arguments.no_figures:
        paths += draw(runs, scenario.figures, folder)
    print(kpi_table.text(figures_of_merit), end="")
    print(f"in {folder}: {', '.join(path.name for path in sorted(folder.iterdir()))}")
    return 0


def _parameters_of_nodes(file: Path) -> dict[str, dict[str, Any]]:
    """Parameters by controller from a parameter file of ROS."""
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
        return {str(node).strip("/").removeprefix("fsw_"): dict(of["ros__parameters"]) for node, of in content.items()}
    except OSError as error:
        raise CommandError(f"cannot read {file}: {error.strerror}") from None
    except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError):
        raise CommandError(f"{file}: not a parameter file: give NODE: {{ros__parameters: {{NAME: VALUE}}}}") from None


def assignment(option: str, text: str) -> tuple[str, Any]:
    """Name and value, which is YAML, of an argument NAME=VALUE."""
    name, separator, value = text.partition("=")
    if not separator or not name.strip():
        raise CommandError(f"{option} {text}: write NAME=VALUE")
    try:
        return name.strip(), yaml.safe_load(value)
    except yaml.YAMLError:
        return name.strip(), value


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
