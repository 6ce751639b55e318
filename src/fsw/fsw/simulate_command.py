"""``fsw.py simulate``: scenarios offline."""

from __future__ import annotations

import argparse
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fsw.bags import print_notes
from fsw.command import (
    FORCE,
    FORMAT,
    REQUIRE_SIGNED_PROCEDURE,
    TRUSTED,
    assigned,
    command,
    file,
    option,
    parameter,
    parameters_by_node,
    repeated,
    switch,
)
from fsw.console import ProgressBar, listed, new_folder, print_table
from fsw.errors import HOW, CommandError, middleware_is_here
from fsw.simulation import closed_loop
from fsw_analysis import kpi, kpi_table, phase_kpi
from fsw_analysis.figures import Run, draw, draw_whole_weld
from fsw_analysis.weld_signals import export_weld
from fsw_control.free_domain import free_domain
from fsw_control.schema.models import content_of, read_text
from fsw_control.weld import TICK_S
from fsw_plant import PlantConfig, prepare
from fsw_recorder.bag_metadata import IDENTITY
from fsw_scenario.closed_loop import ClosedLoop, unhealthy
from fsw_scenario.controllers import KNOWN, name_of, with_variant
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.procedure import check_signed, graph_parameters
from fsw_scenario.procedure import shipped as procedures
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, shipped
from fsw_scenario.weld_programme import spans


@command(
    "simulate",
    "run a scenario offline; writes signals, figures of merit and figures",
    option("scenario", nargs="?", help=f"YAML file, or one of {', '.join(shipped())}"),
    option(
        "--controller",
        action="append",
        metavar="NAME[:TUNING]",
        help="run with this controller instead of the scenario's; "
        "several times: compare, e.g. decentral:tight; your own: MODULE:CLASS or FILE.py:CLASS",
    ),
    parameter("parameter of a controller's node, e.g. nmpc.tuning_file=tuning.yaml"),
    repeated(
        "--params-file",
        "FILE",
        "parameters of controllers' nodes, in ROS's format, e.g. from fsw.py tune",
        type=Path,
    ),
    file("--heat", "heat profile of the type of weld, from fsw.py learn"),
    switch("--no-noise", "no sensor noise, no quantisation"),
    repeated(
        "--set",
        "KEY=VALUE",
        "replace a value of the scenario, e.g. plant.seed=3 or events[0].at_s=10",
    ),
    file("--out", "folder for the results (default out/<date>_<scenario>)", "DIR"),
    switch("--bag", "also run the weld in the graph, in lockstep, and record it"),
    option(
        "--procedure",
        metavar="PROCEDURE",
        default="",
        help="with --bag: procedure that it is welded by, whose limits hold; "
        "the weld's record is written into the "
        f"bag; one of {', '.join(procedures())}",
    ),
    TRUSTED,
    REQUIRE_SIGNED_PROCEDURE,
    repeated(
        "--identity",
        "KEY=VALUE",
        "with --bag: identity of the welded parts, for the bag's metadata and the record: "
        f"{', '.join(IDENTITY)}",
    ),
    switch("--no-figures", "figures of merit only"),
    FORMAT,
    FORCE,
    switch("--list", "list the shipped scenarios and exit"),
    description="Run a scenario in this process, without middleware: "
    "plant emulator and controllers at full speed.",
)
def simulate(arguments: argparse.Namespace) -> int:
    if arguments.list:
        print_table([(name, " ".join(load(name).description.split())) for name in shipped()])
        return 0
    if arguments.scenario is None:
        raise CommandError(
            f"simulate: give a scenario, one of {', '.join(shipped())}, or a YAML file"
        )
    by_procedure: dict[str, dict[str, Any]] = {}
    if arguments.require_signed and not arguments.procedure:
        raise CommandError("simulate: --require-signed needs --procedure")
    if arguments.procedure:
        if not arguments.bag:
            raise CommandError(
                "simulate: --procedure needs --bag: offline there is no supervisor, no record"
            )
        check_signed(arguments.procedure, arguments.trusted, arguments.require_signed)
        by_procedure = graph_parameters(arguments.procedure)
    identity = _identity(arguments)
    overrides = [*arguments.set, *(["plant.noise=false"] if arguments.no_noise else [])]
    scenario = load(arguments.scenario, overrides)
    if scenario.open_loop and arguments.controller:
        raise CommandError(
            f"simulate: {scenario.name} is an open-loop scenario; it takes no --controller"
        )
    if arguments.bag and not middleware_is_here():
        raise CommandError(f"simulate: --bag needs ROS 2: {HOW}")
    parameters = _parameters(arguments, scenario)
    loops = _loops(arguments, scenario, overrides, parameters)
    folder = new_folder(arguments, scenario.name)
    runs: list[Run] = []
    for title, (label, loop) in loops.items():
        with ProgressBar(f"{scenario.name}, {title}") as bar:
            runs.append(Run(title, loop.run(bar)))
        _print_health(runs[-1])
        file = title.replace(":", "_").replace(" ", "_")
        export_weld(runs[-1].signals, folder / f"signals_{file}.csv")
        if arguments.bag:
            _record(
                loop.scenario,
                label,
                parameters,
                folder / f"graph_{file}",
                by_procedure,
                identity,
                arguments.heat,
            )
    ending = None if arguments.no_figures else arguments.format or "png"
    write_results(scenario, runs, folder, ending)
    print(listed(folder))
    return 0


def _loops(
    arguments: argparse.Namespace,
    scenario: Scenario,
    overrides: list[str],
    parameters: Mapping[str, dict[str, Any]],
) -> dict[str, tuple[str, ClosedLoop]]:
    """Label of the controller and closed loop of each run, by title."""
    labels = list(dict.fromkeys(arguments.controller or [scenario.controller]))
    loops = {}
    used: set[str] = set()
    with ProgressBar("heat conduction in the canister") as bar:
        prepare(PlantConfig.from_values(scenario.plant), lambda share, _: bar(share))
    for label in labels:
        title, loop = closed_loop(
            arguments.scenario,
            None if scenario.open_loop else label,
            overrides,
            parameters,
            arguments.heat,
        )
        used |= set(loop.scenario.controllers)
        if len(labels) == 1 and len(loop.scenario.controllers) > 1:
            title = " and ".join(loop.scenario.controllers)
        loops[title] = (label, loop)
    unused = [name for name in parameters if name not in used]
    if unused:
        raise CommandError(
            f"simulate: --parameter is for {', '.join(unused)}, "
            f"but {', '.join(used) or 'none'} run"
        )
    return loops


def write_results(
    scenario: Scenario, runs: Sequence[Run], folder: Path, ending: str | None = "png"
) -> list[Path]:
    """Print and write figures of merit and figures (by phase for a whole weld); returns files.

    ``ending`` is the figures' format, or None to leave them out.
    """
    results = [kpi.compute(run.signals, run.label) for run in runs]
    text = kpi_table.markdown(results)
    print(text, end="")
    paths = kpi_table.write_both(results, text, folder / "kpi")
    if ending:
        paths += draw(runs, scenario.figures, folder, ending=ending)
    if scenario.phases:
        phases = [
            phase_kpi.recorded_spans(run.signals)
            or spans(scenario.phases, run.signals.n_ticks * TICK_S)
            for run in runs
        ]
        by_phase = [
            phase_kpi.compute(run.signals, run.label, inside)
            for run, inside in zip(runs, phases, strict=True)
        ]
        rows = [asdict(row) for run in by_phase for row in run]
        paths += kpi_table.write_both(rows, phase_kpi.markdown(by_phase), folder / "phases")
        if ending:
            paths.append(folder / f"weld.{ending}")
            draw_whole_weld(runs, phases[0], f"Whole weld ({scenario.name})", paths[-1])
    return paths


def _print_health(run: Run) -> None:
    """Report on stderr how often a controller was unhealthy, and the first reason."""
    remarks = filter(None, (unhealthy(run.signals, name) for name in run.signals.proposals))
    notes = dict.fromkeys([*run.signals.problems, *remarks])
    print_notes(f"{run.label}: {note}" for note in notes)


def _record(
    scenario: Scenario,
    label: str,
    parameters: Mapping[str, dict[str, Any]],
    folder: Path,
    by_procedure: Mapping[str, dict[str, Any]],
    identity: Sequence[str],
    heat: Path | None,
) -> None:
    """Run a scenario in the graph, in lockstep, and store its bag in a folder."""
    nodes = {name: parameters.get(name, {}) for name in scenario.controllers}
    if not scenario.open_loop:
        nodes[name_of(label)] = with_variant(label, nodes[name_of(label)])
    companions = ["procedure"] if by_procedure else []
    derived = dict(by_procedure)
    if identity:
        derived["fsw_recorder"] = {
            **derived.get("fsw_recorder", {}),
            "custom_data": list(identity),
        }
    graph = WeldGraph(
        scenario, folder, parameters=nodes, companions=companions, derived=derived, heat=heat
    )
    run_side_by_side([graph], 1)
    if "on_finished" in by_procedure.get("fsw_recorder", {}):
        print_notes([f"the record of the weld is being written to {graph.bag / 'record'}"])


def _identity(arguments: argparse.Namespace) -> list[str]:
    """Identity of the welded parts from the options, as parameters of the recorder."""
    if arguments.identity and not arguments.bag:
        raise CommandError("simulate: --identity needs --bag: it is noted in the bag")
    form = f"KEY=VALUE with one of {', '.join(IDENTITY)}"
    parts = assigned("simulate: --identity", arguments.identity, form)
    for key, value in parts.items():
        if key not in IDENTITY:
            raise CommandError(f"simulate: --identity {key}={value}: write {form}")
    return [f"{key}={value}" for key, value in parts.items()]


class _StoppedError(Exception):
    """Another weld has failed, or the user has interrupted."""


def run_side_by_side(graphs: Sequence[WeldGraph], at_a_time: int) -> None:
    """Run all welds to their ends; on a failure or Ctrl-C end all and raise the first exception.

    A lockstep weld waits for messages half of the time; about one weld per core is the fastest.
    """
    stop = threading.Event()
    shares = [0.0] * len(graphs)

    def run(position: int, graph: WeldGraph, bar: ProgressBar) -> None:
        def progress(share: float) -> None:
            if stop.is_set():
                raise _StoppedError
            shares[position] = share
            bar(sum(shares) / len(shares))

        if stop.is_set():
            raise _StoppedError
        with free_domain() as domain, Launcher(graph.folder / "log", domain) as launcher:
            graph.run(launcher, progress)

    title = f"{len(graphs)} welds, {min(at_a_time, len(graphs))} at a time"
    title = title if len(graphs) > 1 else f"weld in the graph, {graphs[0].folder}"
    # threads that live until all welds have ended: the kernel ends the children of a dead thread
    with ProgressBar(title) as bar, ThreadPoolExecutor(at_a_time) as pool:
        futures = [pool.submit(run, position, graph, bar) for position, graph in enumerate(graphs)]
        try:
            for future in as_completed(futures):
                future.result()
        except BaseException:
            stop.set()
            raise


def _parameters(arguments: argparse.Namespace, scenario: Scenario) -> dict[str, dict[str, Any]]:
    """Parameters by controller, from files and options."""
    parameters: dict[str, dict[str, Any]] = {}
    for source in arguments.params_file:
        parameters.update(_parameters_in(source))
    labels = [] if scenario.open_loop else arguments.controller or [scenario.controller]
    later = [event.switch for event in scenario.events if event.switch is not None]
    nodes = list(dict.fromkeys([*map(name_of, labels), *later]))
    for node, values in parameters_by_node(arguments.parameter, nodes, KNOWN).items():
        parameters.setdefault(node, {}).update(values)
    return parameters


def _parameters_in(file: Path) -> dict[str, dict[str, Any]]:
    """Parameters by controller from a parameter file of ROS."""
    content = content_of(read_text(file, "parameter file"), str(file))
    try:
        return {
            str(node).strip("/").removeprefix("fsw_"): dict(of["ros__parameters"])
            for node, of in content.items()
        }
    except (AttributeError, KeyError, TypeError, ValueError):
        raise CommandError(
            f"{file}: not a parameter file: give NODE: {{ros__parameters: {{NAME: VALUE}}}}"
        ) from None
