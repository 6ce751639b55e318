"""The demonstration: the whole graph as processes, its bags, figures of merit and figures."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from fsw_analysis import kpi, kpi_table
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.signals import load_weld
from fsw_control.free_domain import free_domain
from fsw_experiment import live
from fsw_experiment.cli.errors import CommandError, exit_code
from fsw_experiment.cli.progress import ProgressBar
from fsw_experiment.cli.simulate import new_folder, write_phases
from fsw_experiment.controllers import KNOWN
from fsw_experiment.graph import WeldGraph
from fsw_experiment.launcher import Launcher
from fsw_experiment.scenario import Scenario
from fsw_experiment.scenario_file import load, parse, shipped

DEFAULT_SCENARIOS = ("reference_tracking", "output_disturbances")
SWAP_SCENARIO = "controller_swap"
LIVE_SCENARIO = "canister_weld"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    whole = argparse.ArgumentParser(
        prog="demo.py",
        description="Run welds in closed loop over DDS; plant, controllers, supervisor, recorder and player are "
        "processes. Leaves bags, figures of merit and figures.",
    )
    whole.add_argument("--realtime", action="store_true", help="10 Hz on the wall clock instead of as fast as possible")
    whole.add_argument(
        "--scenario",
        action="append",
        metavar="NAME",
        help=f"YAML file or one of {', '.join(shipped())}; several times (default: {', '.join(DEFAULT_SCENARIOS)})",
    )
    whole.add_argument(
        "--controller",
        action="append",
        metavar="NAME",
        help="compare only these controllers, in this order (default: all)",
    )
    whole.add_argument(
        "--live",
        action="store_true",
        help="one weld in real time, to watch and steer on the operator's page "
        f"(default: {LIVE_SCENARIO}, 45 min, with all controllers, recorder and standby supervisor)",
    )
    whole.add_argument("--port", type=int, default=8080, help="of the page of --live; 0: any free one (default 8080)")
    whole.add_argument("--out", type=Path, help="folder for the results (default: out/<date>)")
    return whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration; returns the exit code."""
    parsed = parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    return exit_code(lambda: _live(parsed) if parsed.live else _demonstrate(parsed))


def _live(parsed: argparse.Namespace) -> int:
    names = parsed.scenario or [LIVE_SCENARIO]
    if len(names) > 1:
        raise CommandError("--live welds once: give one --scenario")
    controllers = _controllers(parsed)
    scenario = load(names[0])
    if not scenario.open_loop and len(scenario.controllers) == 1:
        scenario = parse(scenario.text, scenario.name, [f"controller={controllers[0]}"])
    folder = new_folder(parsed.out, "live")
    graph = WeldGraph(scenario, folder, () if scenario.open_loop else controllers, realtime=True, standby=True)
    with free_domain() as domain, Launcher(folder / "log", domain) as launcher:
        return live.weld(graph, launcher, parsed.port)


def _controllers(parsed: argparse.Namespace) -> list[str]:
    """The controllers asked for, or all."""
    controllers = list(dict.fromkeys(parsed.controller or KNOWN))
    unknown = [name for name in controllers if name not in KNOWN]
    if unknown:
        raise CommandError(f"no controller {', '.join(unknown)}; known: {', '.join(KNOWN)}")
    return controllers


def _demonstrate(parsed: argparse.Namespace) -> int:
    controllers = _controllers(parsed)
    names = list(parsed.scenario or DEFAULT_SCENARIOS)
    if not parsed.scenario and len(controllers) > 1:
        names.append(SWAP_SCENARIO)
    scenarios = [load(name) for name in names]
    began = time.monotonic()
    folder = new_folder(parsed.out, "demo")
    pace = "10 Hz on the wall clock" if parsed.realtime else "lockstep, as fast as the slowest process"
    print(f"weld in closed loop over DDS, {pace}; results go to {folder}", file=sys.stderr)
    written: list[Path] = []
    for scenario in scenarios:
        written += _weld(scenario, controllers, folder, parsed.realtime)
    print(f"done in {time.monotonic() - began:.0f} s; look at")
    for path in written:
        print(f"  {path}")
    return 0


def _weld(scenario: Scenario, controllers: Sequence[str], folder: Path, realtime: bool) -> list[Path]:
    """Run a scenario once with each controller in command; the others run along."""
    from fsw_analysis.figures import Run, draw  # matplotlib takes a second to import

    place = folder / scenario.name
    runs: list[Run] = []
    bags: list[Path] = []
    for title, variant in _variants(scenario, controllers).items():
        own = place / title.replace(" ", "_")
        graph = WeldGraph(variant, own, () if variant.open_loop else controllers, realtime)
        with (
            ProgressBar(f"{scenario.name}, {title}") as bar,
            free_domain() as domain,
            Launcher(own / "log", domain) as launcher,
        ):
            graph.run(launcher, bar)
        runs.append(Run(title, cut_to_scenario(load_weld(graph.bag))))
        bags.append(graph.bag)
    results = [kpi.compute(run.signals, run.label) for run in runs]
    print(f"\n{scenario.name}: {' '.join(scenario.description.split())}")
    print(kpi_table.text(results))
    pages = draw(runs, scenario.figures, place)
    return [*bags, *kpi_table.write(results, place), *pages, *write_phases(scenario, runs, place)]


def _variants(scenario: Scenario, controllers: Sequence[str]) -> dict[str, Scenario]:
    if scenario.open_loop:
        return {"open loop": scenario}
    if len(scenario.controllers) > 1:
        return {"swap": scenario}
    return {name: parse(scenario.text, scenario.name, [f"controller={name}"]) for name in controllers}


if __name__ == "__main__":
    sys.exit(main())
