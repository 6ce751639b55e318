"""``fsw.py export fmu``: the plant or a controller as a Functional Mock-up Unit."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw_experiment.cli.errors import CommandError
from fsw_experiment.cli.simulate import assignment


def add_kind(kinds: Any) -> None:
    """Add the kind to those of ``export``."""
    parser = kinds.add_parser(
        "fmu",
        help="the plant or a controller as a Functional Mock-up Unit (FMI 2.0, co-simulation)",
        description="Write a Functional Mock-up Unit: FMI 2.0 for co-simulation with a fixed step of 0.1 s, with "
        "sources and a binary for this machine. Prints its variables.",
    )
    parser.add_argument("unit", help="plant, nmpc or decentral")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.fmu", help="file to write")
    parser.add_argument("--force", action="store_true", help="replace the file if it exists")
    parser.add_argument("--model", type=Path, metavar="FILE", help="model parameters (YAML) instead of the paper's")
    parser.add_argument(
        "--tuning", type=Path, metavar="FILE", help="tuning of the NMPC (YAML) instead of the default one"
    )
    parser.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="parameter of the plant or of the controller's node; may be repeated, e.g. start.depth_mm=2.8",
    )
    parser.add_argument(
        "--platform",
        action="append",
        default=[],
        choices=["linux64", "win64"],
        help="also a binary for this platform, by zig's compiler; may be repeated",
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from fsw_export import fmu
    from fsw_export.c_folder import ExportError
    from fsw_export.fmu_description import table

    values = dict(assignment("--parameter", text) for text in arguments.parameter)
    try:
        content = fmu.make(arguments.unit, arguments.model, arguments.tuning, values)
        fmu.write(content, arguments.out, arguments.force, arguments.platform)
    except (ValueError, ExportError) as error:
        raise CommandError(f"export fmu: {error}") from None
    print(table(content))
    print(f"{arguments.out}: {len(content.variables)} variables, {arguments.out.stat().st_size / 1000:.0f} kB")
    return 0
