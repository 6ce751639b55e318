"""``fsw.py simulate``: scenarios offline."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from fsw.errors import CommandError
from fsw.progress import ProgressBar
from fsw_analysis import kpi_table, phase_kpi
from fsw_control.free_domain import free_domain
from fsw_control.yaml_text import load_yaml
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, shipped
from fsw_scenario.weld_programme import spans

if TYPE_CHECKING:
    from fsw_analysis.figures import Run


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
        help="run with this controller instead of the scenario's; several times: compare, e.g. decentral:tight; one of "
        "your own: MODULE:CLASS or FILE.py:CLASS",
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
        help="replace a value of the scenario, e.g. plant.seed=3 or events[0].at_s=10",
    )
    parser.add_argument("--out", type=Path, help="folder for the results (default out/<date>_<scenario>)")
    parser.add_argument("--bag", action="store_true", help="also run the weld in the graph, in lockstep, and record it")
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
    from fsw_scenario.closed_loop import ClosedLoop
    from fsw_scenario.controllers import make_all, name_of, short, variant_of

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
        if not name or not inner:
            raise CommandError(f"simulate: --parameter {text}: write CONTROLLER.NAME=VALUE")
        parameters.setdefault(name, {})[inner] = value
    loops: dict[str, ClosedLoop] = {}
    nodes: dict[str, dict[str, dict[str, Any]]] = {}
    used: set[str] = set()
    for label in labels:
        name = label if scenario.open_loop else name_of(label)
        chosen = load(arguments.scenario, [*overrides, f"controller={name}"])
        controllers = make_all(chosen, label, parameters)
        used |= controllers.keys()
        title = "open loop" if chosen.open_loop else short(label)
        if len(labels) == 1 and len(controllers) > 1:
            title = " and ".join(controllers)
        nodes[title] = {other: {**parameters.get(other, {})} for other in controllers}
        if not chosen.open_loop:
            nodes[title][name].update(variant_of(label))
        loops[title] = ClosedLoop(chosen, controllers)
    unused = [name for name in parameters if name not in used]
    if unused:
        raise CommandError(f"simulate: --parameter is for {', '.join(unused)}, but {', '.join(used) or 'none'} run")
    folder = new_folder(arguments.out, scenario.name)
    runs: list[Run] = []
    for title, loop in loops.items():
        with ProgressBar(f"{scenario.name}, {title}") as bar:
            runs.append(Run(title, loop.run(bar)))
        _tell_unhealthy(runs[-1])
        export_weld(runs[-1].signals, folder / f"signals_{_file_name(title)}.csv")
        if arguments.bag:
            _record(loop.scenario, folder / f"graph_{_file_name(title)}", nodes[title])
    figures_of_merit = [kpi.compute(one.signals, one.label) for one in runs]
    kpi_table.write(figures_of_merit, folder)
    if not arguments.no_figures:
        draw(runs, scenario.figures, folder)
    write_phases(scenario, runs, folder, figure=not arguments.no_figures)
    print(kpi_table.markdown(figures_of_merit), end="")
    print(f"in {folder}: {', '.join(path.name for path in sorted(folder.iterdir()))}")
    return 0


def write_phases(scenario: Scenario, runs: Sequence[Run], folder: Path, figure: bool = True) -> list[Path]:
    """Figures of merit by phase, and the figure, of a whole weld; nothing of another scenario. Returns the files."""
    if not scenario.phases:
        return []
    phases = [phase_kpi.recorded_spans(run.signals) or spans(scenario.phases) for run in runs]
    figures = [phase_kpi.compute(run.signals, run.label, inside) for run, inside in zip(runs, phases, strict=True)]
    paths = phase_kpi.write(figures, folder)
    if figure:
        from fsw_analysis.figures import draw_whole_weld

        paths.append(folder / "weld.png")
        draw_whole_weld(runs, phases[0], f"Whole weld ({scenario.name})", paths[-1])
    return paths


def _tell_unhealthy(run: Run) -> None:
    """Say on stderr how often a controller was not healthy, and why at first."""
    notes = list(run.signals.problems)
    for name, proposal in run.signals.proposals.items():
        ticks = np.flatnonzero(proposal.healthy == 0.0)
        if ticks.size:
            text = f"{name} is not healthy at {ticks.size} of {run.signals.n_ticks} ticks"
            notes.append(f"{text}, first at {run.signals.time_s[ticks[0]]:.1f} s: {proposal.reason[ticks[0]]}")
    print("".join(f"note: {run.label}: {note}\n" for note in notes), end="", file=sys.stderr)


def _file_name(title: str) -> str:
    return title.replace(":", "_").replace(" ", "_")


def _record(scenario: Scenario, folder: Path, parameters: dict[str, dict[str, Any]]) -> None:
    """Run a scenario in the graph, in lockstep, and leave its bag in a folder."""
    graph = WeldGraph(scenario, folder, parameters=parameters)
    with (
        free_domain() as domain,
        Launcher(folder / "log", domain) as launcher,
        ProgressBar(f"{scenario.name}, bag {graph.bag}") as bar,
    ):
        graph.run(launcher, bar)


def _parameters_of_nodes(file: Path) -> dict[str, dict[str, Any]]:
    """Parameters by controller from a parameter file of ROS."""
    try:
        content = load_yaml(file.read_text(encoding="utf-8"))
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
        return name.strip(), load_yaml(value)
    except yaml.YAMLError:
        return name.strip(), value


def new_folder(wanted: Path | None, name: str) -> Path:
    """Make a folder for results.

    Raises
    ------
    CommandError
        When it exists already and is not empty, or cannot be made.
    """
    folder = wanted or default_folder(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise CommandError(f"folder {folder} exists and is not empty; nothing is overwritten, choose another --out")
    except OSError as error:
        raise CommandError(f"cannot make folder {folder}: {error.strerror}") from None
    return folder


def default_folder(name: str) -> Path:
    """Folder for results where none is given."""
    return Path("out") / f"{time.strftime('%Y%m%d-%H%M%S')}_{name}"
