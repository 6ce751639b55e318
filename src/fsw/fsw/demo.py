"""The demonstration: the whole graph as processes, with bags, figures of merit and figures."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from fsw.command import FORCE, FORMAT, command, file, option, switch
from fsw.console import ProgressBar, new_folder
from fsw.errors import HOW, CommandError, exit_code, middleware_is_here
from fsw.simulate_command import run_side_by_side, write_results
from fsw.simulation import closed_loop
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.figures import Run
from fsw_analysis.signals import load_weld
from fsw_control.free_domain import free_domain
from fsw_hmi.main import EXTRA
from fsw_model import ModelParameters
from fsw_model.heat_profile import HeatProfile
from fsw_plant import PlantConfig, prepare
from fsw_scenario import live
from fsw_scenario.controllers import OURS, variants_of
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, shipped, with_controller
from fsw_scenario.weld_programme_course import HeatAhead

DEFAULT_SCENARIOS = ("reference_tracking", "output_disturbances")
SWAP_SCENARIO = "controller_swap"
LIVE_SCENARIO = "canister_weld"


@command(
    "demo",
    "run welds in closed loop over DDS, in processes; with the operator's page: --live",
    switch("--realtime", "10 Hz in real time instead of as fast as possible"),
    option(
        "--scenario",
        action="append",
        metavar="NAME",
        help=f"YAML file or one of {', '.join(shipped())}; "
        f"several times (default: {', '.join(DEFAULT_SCENARIOS)})",
    ),
    option(
        "--controller",
        action="append",
        metavar="NAME",
        help=f"compare only these controllers, in this order (default: {', '.join(OURS)}); "
        "your own: MODULE:CLASS or FILE.py:CLASS",
    ),
    switch(
        "--live",
        "one weld in real time, to monitor and control on the operator's page "
        f"(default: {LIVE_SCENARIO}, 45 min, "
        "with all controllers, recorder and standby supervisor)",
    ),
    option(
        "--port",
        type=int,
        default=8080,
        help="of the page of --live; 0: any free one (default 8080)",
    ),
    file("--heat", "with --live: heat profile of the type of weld, from fsw.py learn"),
    file("--model", "with --live: model of the NMPC (YAML), e.g. that of the heat profile"),
    option("--out", type=Path, help="folder for the results (default: out/<date>)"),
    FORMAT,
    FORCE,
    description="Run welds in closed loop over DDS; "
    "plant, controllers, supervisor, recorder and player are "
    "processes. Leaves bags, figures of merit and figures.",
)
def demo(parsed: argparse.Namespace) -> int:
    """Run the demonstration; returns the exit code."""
    if not (parsed.live or parsed.heat is parsed.model is None):
        raise CommandError("--heat and --model need --live")
    return _live(parsed) if parsed.live else _demonstrate(parsed)


def parser() -> argparse.ArgumentParser:
    """The command line of the script."""
    whole = argparse.ArgumentParser(prog="demo.py", description=demo.description)
    for add in demo.options:
        add(whole)
    return whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script; returns the exit code."""
    parsed = parser().parse_args(arguments)
    return exit_code(lambda: demo(parsed))


def _live(parsed: argparse.Namespace) -> int:
    names = parsed.scenario or [LIVE_SCENARIO]
    if len(names) > 1:
        raise CommandError("--live welds once: give one --scenario")
    controllers = variants_of(parsed.controller or OURS)
    scenario = with_controller(load(names[0]), next(iter(controllers)))
    if parsed.model is not None:
        ModelParameters.from_file(parsed.model)  # else the NMPC refuses it
        if "nmpc" not in controllers:
            raise CommandError("--model is for nmpc, which does not run")
        controllers["nmpc"]["model_file"] = str(parsed.model.absolute())
    if parsed.heat is not None:
        # else the player refuses it
        HeatAhead(HeatProfile.from_file(parsed.heat), scenario.phases)
    if not middleware_is_here():
        raise CommandError(f"--live needs ROS 2: {HOW}")
    EXTRA.need("--live")
    prepare(PlantConfig.from_values(scenario.plant))
    folder = new_folder(parsed, "live")
    others = () if scenario.open_loop else tuple(controllers)
    graph = WeldGraph(
        scenario,
        folder,
        others,
        realtime=True,
        standby=True,
        parameters=controllers,
        heat=parsed.heat,
    )
    with free_domain() as domain, Launcher(folder / "log", domain) as launcher:
        return live.weld(graph, launcher, parsed.port)


def _demonstrate(parsed: argparse.Namespace) -> int:
    controllers = variants_of(parsed.controller or OURS)
    names = list(parsed.scenario or DEFAULT_SCENARIOS)
    if not parsed.scenario and len(controllers) > 1:
        names.append(SWAP_SCENARIO)
    scenarios = [load(name) for name in names]
    if parsed.realtime and not middleware_is_here():
        raise CommandError(f"--realtime needs ROS 2: {HOW}")
    for scenario in scenarios:
        prepare(PlantConfig.from_values(scenario.plant))
    began, ending = time.monotonic(), parsed.format or "png"
    folder = new_folder(parsed, "demo")
    if middleware_is_here():
        pace = "10 Hz on the wall clock" if parsed.realtime else "lockstep, as fast as possible"
        print(f"weld in closed loop over DDS, {pace}; results go to {folder}", file=sys.stderr)
        welds = [_graphs(scenario, controllers, folder, parsed.realtime) for scenario in scenarios]
        at_a_time = 1 if parsed.realtime else os.cpu_count() or 1
        run_side_by_side([graph for graphs in welds for graph in graphs.values()], at_a_time)
        written = [
            path
            for scenario, graphs in zip(scenarios, welds, strict=True)
            for path in _results(scenario, graphs, folder / scenario.name, ending)
        ]
    else:
        print(
            f"no ROS 2 here: welds in one process, without bags; results go to {folder}",
            file=sys.stderr,
        )
        written = [
            path
            for name in names
            for path in _without_middleware(name, controllers, folder, ending)
        ]
    print(f"done in {time.monotonic() - began:.0f} s; look at")
    print("\n".join(f"  {path}" for path in written))
    return 0


def _without_middleware(
    name: str, controllers: dict[str, dict[str, str]], folder: Path, ending: str
) -> list[Path]:
    """Run a scenario once per controller in this process; returns the files."""
    scenario = load(name)
    runs: list[Run] = []
    for title in _variants(scenario, controllers):
        label = title if title in controllers else None
        _, loop = closed_loop(name, label, [], controllers if label else {})
        with ProgressBar(f"{scenario.name}, {title}") as bar:
            runs.append(Run(title, loop.run(bar)))
    print(f"\n{scenario.name}: {' '.join(scenario.description.split())}\n")
    place = folder / scenario.name
    place.mkdir()
    return write_results(scenario, runs, place, ending)


def _graphs(
    scenario: Scenario, controllers: dict[str, dict[str, str]], folder: Path, realtime: bool
) -> dict[str, WeldGraph]:
    """Welds of a scenario by title: each controller commands once while the others run along."""
    graphs = {}
    for title, variant in _variants(scenario, controllers).items():
        others = () if variant.open_loop else tuple(controllers)
        own = folder / scenario.name / title.replace(" ", "_")
        graphs[title] = WeldGraph(variant, own, others, realtime, parameters=controllers)
    return graphs


def _results(
    scenario: Scenario, graphs: dict[str, WeldGraph], place: Path, ending: str
) -> list[Path]:
    """Print and write the figures of merit of the welds of a scenario; returns the files."""
    runs = [Run(title, cut_to_scenario(load_weld(graph.bag))) for title, graph in graphs.items()]
    print(f"\n{scenario.name}: {' '.join(scenario.description.split())}\n")
    return [
        *(graph.bag for graph in graphs.values()),
        *write_results(scenario, runs, place, ending),
    ]


def _variants(scenario: Scenario, controllers: Iterable[str]) -> dict[str, Scenario]:
    if scenario.open_loop:
        return {"open loop": scenario}
    if len(scenario.controllers) > 1:
        return {"swap": scenario}
    return {name: with_controller(scenario, name) for name in controllers}


if __name__ == "__main__":
    sys.exit(main())
