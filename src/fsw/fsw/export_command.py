"""``fsw.py export``: controllers and plant for use outside ROS 2."""

from __future__ import annotations

import argparse
from typing import Any

import fsw
from fsw.console import print_table
from fsw.errors import CommandError
from fsw.options import add_file, add_repeated
from fsw.progress import ProgressBar
from fsw.simulate_command import assignment


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    parser = commands.add_parser(
        "export",
        help="a controller as C99 for a PLC, a controller or the plant as an FMU",
        description="Export controllers and plant for use outside ROS 2.",
    )
    kinds = parser.add_subparsers(title="kinds", metavar="KIND", required=True)
    c = kinds.add_parser(
        "c",
        help="a controller as a self-contained folder of C99",
        description="Write a folder with a controller in C99: sources, tables, example, test vectors of a simulated "
        "weld, function block, README. The example is compiled and run before the folder is moved into place.",
    )
    c.add_argument(
        "--controller",
        dest="unit",
        choices=["nmpc", "decentral"],
        default="nmpc",
        help="controller to export (default nmpc)",
    )
    _add_choice(c, "parameter of the controller's node, e.g. temperature_aggressiveness=0.5")
    add_file(c, "--out", "folder to write", "DIR", required=True)
    c.add_argument("--force", action="store_true", help="delete an existing export")
    c.set_defaults(run=_run_c)
    fmu = kinds.add_parser(
        "fmu",
        help="the plant or a controller as a Functional Mock-up Unit (FMI 2.0, co-simulation)",
        description="Write a Functional Mock-up Unit: FMI 2.0 for co-simulation with a fixed step of 0.1 s, with "
        "sources and a binary for this machine. Prints its variables.",
    )
    fmu.add_argument("unit", metavar="UNIT", help="plant, nmpc or decentral")
    _add_choice(fmu, "parameter of the plant or of the controller's node, e.g. start.depth_mm=2.8")
    add_file(fmu, "--out", "file to write", "FILE.fmu", required=True)
    fmu.add_argument("--force", action="store_true", help="replace the file if it exists")
    platforms = ("linux64", "win64")
    add_repeated(fmu, "--platform", "NAME", f"also a binary for {' or '.join(platforms)}, by zig", choices=platforms)
    fmu.set_defaults(run=_run_fmu)


def _add_choice(kind: argparse.ArgumentParser, parameter: str) -> None:
    """Add the options that say which model, tuning and parameters are exported; ``parameter`` is a help text."""
    add_file(kind, "--model", "model parameters (YAML) instead of the paper's")
    add_file(kind, "--tuning", "tuning (YAML) instead of the default one")
    add_repeated(kind, "--parameter", "NAME=VALUE", parameter)


def _options(arguments: argparse.Namespace) -> dict[str, Any]:
    """What is exported, and whether it may replace something."""
    values = dict(assignment("--parameter", text) for text in arguments.parameter)
    chosen = {"model": arguments.model, "tuning": arguments.tuning, "parameters": values}
    return chosen | {"replace": arguments.force}


def _run_c(arguments: argparse.Namespace) -> int:
    try:
        with ProgressBar("weld of the test vectors") as bar:
            check = fsw.export_c(arguments.unit, arguments.out, progress=bar, **_options(arguments))
    except RuntimeError as error:
        raise CommandError(f"export c: {error}") from None
    print(check)
    print(f"{arguments.out}: README.md, src, test vectors")
    return 0


def _run_fmu(arguments: argparse.Namespace) -> int:
    options = _options(arguments) | {"platforms": tuple(arguments.platform)}
    try:
        with ProgressBar("heat conduction in the canister") as bar:
            content = fsw.export_fmu(arguments.unit, arguments.out, progress=bar, **options)
    except (ValueError, RuntimeError) as error:
        raise CommandError(f"export fmu: {error}") from None
    variables = content.variables
    print_table([(v.name, v.causality, v.unit or v.type, v.start_text, v.description) for v in variables])
    print(f"{arguments.out}: {len(variables)} variables, {arguments.out.stat().st_size / 1000:.0f} kB")
    return 0
