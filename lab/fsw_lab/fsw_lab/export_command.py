"""``fsw.py export``: controllers and plant for use outside ROS 2."""

from __future__ import annotations

import argparse
from typing import Any

import fsw
from fsw.command import (
    FORCE,
    Option,
    command,
    file,
    group,
    option,
    parameter,
    parameters_by_node,
    repeated,
)
from fsw.console import ProgressBar, print_table
from fsw.errors import CommandError

EXPORT = group(
    "export",
    "a controller as C99 for a PLC, a controller or the plant as an FMU",
    "Export controllers and plant for use outside ROS 2.",
)


def _choice(text: str) -> tuple[Option, ...]:
    """Options that say which model, tuning and parameters are exported.

    The text is on parameters.
    """
    return (
        file("--model", "model parameters (YAML) instead of the paper's"),
        file("--tuning", "tuning (YAML) instead of the default one"),
        parameter(text),
    )


def _options(arguments: argparse.Namespace) -> dict[str, Any]:
    """What is exported, and whether it may replace something."""
    unit = arguments.unit
    values = parameters_by_node(arguments.parameter, [unit]).get(unit, {})
    chosen = {"model": arguments.model, "tuning": arguments.tuning, "parameters": values}
    return chosen | {"replace": arguments.force}


@command(
    "export c",
    "a controller as a self-contained folder of C99",
    option(
        "--controller",
        dest="unit",
        choices=["nmpc", "decentral"],
        default="nmpc",
        help="controller to export (default nmpc)",
    ),
    *_choice("parameter of the controller's node, e.g. temperature_aggressiveness=0.5"),
    file("--out", "folder to write", "DIR", required=True),
    FORCE,
    description="Write a folder with a controller in C99: sources, tables, example, "
    "test vectors of a simulated weld, function block, README. "
    "The example is compiled and run before the folder is moved into place.",
)
def export_c(arguments: argparse.Namespace) -> int:
    try:
        with ProgressBar("weld of the test vectors") as bar:
            check = fsw.export_c(
                arguments.unit, arguments.out, progress=bar, **_options(arguments)
            )
    except RuntimeError as error:
        raise CommandError(f"export c: {error}") from None
    print(check)
    print(f"{arguments.out}: README.md, src, test vectors")
    return 0


@command(
    "export fmu",
    "the plant or a controller as a Functional Mock-up Unit (FMI 2.0, co-simulation)",
    option("unit", metavar="UNIT", help="plant, nmpc or decentral"),
    *_choice("parameter of the plant or of the controller's node, e.g. start.depth_mm=2.8"),
    file("--out", "file to write", "FILE.fmu", required=True),
    FORCE,
    repeated(
        "--platform",
        "NAME",
        "also a binary for linux64 or win64, by zig",
        choices=("linux64", "win64"),
    ),
    description="Write a Functional Mock-up Unit: FMI 2.0 for co-simulation with a fixed step of "
    "0.1 s, with sources and a binary for this machine. Prints its variables.",
)
def export_fmu(arguments: argparse.Namespace) -> int:
    options = _options(arguments) | {"platforms": tuple(arguments.platform)}
    try:
        with ProgressBar("heat conduction in the canister") as bar:
            content = fsw.export_fmu(arguments.unit, arguments.out, progress=bar, **options)
    except (ValueError, RuntimeError) as error:
        raise CommandError(f"export fmu: {error}") from None
    variables = content.variables
    print_table(
        [(v.name, v.causality, v.unit or v.type, v.start_text, v.description) for v in variables]
    )
    print(
        f"{arguments.out}: {len(variables)} variables, "
        f"{arguments.out.stat().st_size / 1000:.0f} kB"
    )
    return 0
