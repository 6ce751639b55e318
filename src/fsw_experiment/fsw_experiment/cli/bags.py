"""``fsw.py bag kpi|plot|compare``: what a weld was like, from its bag alone."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from fsw_experiment.cli.errors import CommandError
from fsw_experiment.cli.progress import ProgressBar


def add_commands(commands: Any) -> None:
    """Add the commands to the subcommands of ``bag``."""
    kpi = commands.add_parser("kpi", help="figures of merit of a weld", description="Figures of merit of a weld.")
    kpi.add_argument("bag", type=Path, help="bag of a weld")
    kpi.add_argument("--json", type=Path, metavar="FILE", help="also write them, with those of each event, as JSON")
    kpi.set_defaults(run=_kpi)

    plot = commands.add_parser("plot", help="the paper's figures of a weld", description="Draw a weld.")
    plot.add_argument("bag", type=Path, nargs="+", help="bags of welds; several are drawn over each other")
    plot.add_argument("--out", type=Path, default=Path("."), help="folder for the PNG files (default: here)")
    plot.add_argument(
        "--figures",
        type=int,
        nargs="*",
        choices=range(4, 10),
        help="the paper's figures 4 to 9 (default: the scenario's)",
    )
    plot.set_defaults(run=_plot)

    compare = commands.add_parser(
        "compare", help="welds side by side", description="Figures of merit of several welds side by side."
    )
    compare.add_argument("bag", type=Path, nargs="+", help="two or more bags of welds")
    compare.add_argument("--json", type=Path, metavar="FILE", help="also write them as JSON")
    compare.add_argument("--out", type=Path, help="also draw the welds over each other into this folder")
    compare.set_defaults(run=_compare)


def load_runs(bags: list[Path]) -> list[Any]:
    """Read bags as runs to draw, each cut to the length of its scenario."""
    from fsw_experiment.figures import Run
    from fsw_experiment.weld_events import cut_to_scenario
    from fsw_recorder.signals import load_weld

    runs = []
    for bag, label in zip(bags, _labels(bags), strict=True):
        bar = ProgressBar(f"reading {bag}")
        signals = load_weld(bag, bar)
        bar.done()
        for problem in signals.problems:
            print(f"note: {label}: {problem}", file=sys.stderr)
        runs.append(Run(label, cut_to_scenario(signals)))
    return runs


def _labels(bags: list[Path]) -> list[str]:
    """Shortest path ends that tell the bags apart."""
    named = [path.resolve().parent if path.resolve().name == "bag" else path.resolve() for path in bags]
    parts = [path.parts for path in named]
    for length in range(1, max(map(len, parts)) + 1):
        labels = ["/".join(part[-length:]) for part in parts]
        if len(set(labels)) == len(labels):
            return labels
    return [f"{path} ({i + 1})" for i, path in enumerate(bags)]


def _figures_of(signals: Any) -> tuple[int, ...]:
    from fsw_experiment.scenario import ScenarioError
    from fsw_experiment.scenario_file import parse

    text = signals.attachments.get("scenario.yaml")
    try:
        return parse(text.decode("utf-8", "replace"), "scenario.yaml of the bag").figures if text else ()
    except ScenarioError as error:
        print(f"note: {error}", file=sys.stderr)
        return ()


def _write_json(path: Path | None, runs: list[dict[str, Any]]) -> None:
    if path is None:
        return
    try:
        path.write_text(json.dumps(runs, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise CommandError(f"cannot write {path}: {error.strerror}") from None


def _folder(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CommandError(f"cannot make folder {path}: {error.strerror}") from None
    return path


def _kpi(arguments: argparse.Namespace) -> int:
    from fsw_experiment import kpi, kpi_table

    results = [kpi.compute(run.signals, run.label) for run in load_runs([arguments.bag])]
    print(kpi_table.text(results), end="")
    _write_json(arguments.json, results)
    return 0


def _plot(arguments: argparse.Namespace) -> int:
    from fsw_experiment.figures import draw

    runs = load_runs(arguments.bag)
    numbers = arguments.figures if arguments.figures is not None else _figures_of(runs[0].signals)
    for path in draw(runs, numbers, _folder(arguments.out)):
        print(path)
    return 0


def _compare(arguments: argparse.Namespace) -> int:
    from fsw_experiment import kpi, kpi_table
    from fsw_experiment.figures import draw

    if len(arguments.bag) < 2:
        raise CommandError("bag compare: give two bags or more")
    runs = load_runs(arguments.bag)
    results = [kpi.compute(run.signals, run.label) for run in runs]
    print(kpi_table.text(results), end="")
    _write_json(arguments.json, results)
    if arguments.out is not None:
        for path in draw(runs, _figures_of(runs[0].signals), _folder(arguments.out)):
            print(path)
    return 0
