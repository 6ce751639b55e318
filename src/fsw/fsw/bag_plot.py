"""``fsw.py bag plot``: figures of welds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.bags import add_bag_command, print_notes, welds_of
from fsw.errors import CommandError
from fsw.options import add_file, add_force
from fsw.outputs import check_new
from fsw_scenario.scenario_file import parse
from fsw_schema.models import InputError


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    text = "the paper's figures of a weld; several bags are overlaid"
    plot = add_bag_command(commands, "plot", _run, text, several=True)
    add_file(plot, "--out", "folder for the PNG files (default: here)", "DIR", default=Path("."))
    text = "figures 4 to 9 (default: the scenario's)"
    plot.add_argument("--figures", type=int, nargs="*", choices=range(4, 10), help=text)
    add_force(plot)


def _run(arguments: argparse.Namespace) -> int:
    from fsw_analysis.figures import Run, draw  # matplotlib takes a second to import

    welds, folder, numbers = welds_of(arguments.bag), arguments.out, arguments.figures
    text = next(iter(welds.values())).attachments.get("scenario.yaml")
    if numbers is None and text:
        try:
            numbers = parse(text.decode("utf-8", "replace"), "scenario.yaml of the bag").figures
        except InputError as error:
            print_notes([str(error)])
    names = (*(f"fig{one}" for one in numbers or ()), "overview")
    check_new([folder / f"{name}.png" for name in names], arguments.force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths = draw([Run(label, signals) for label, signals in welds.items()], numbers or (), folder)
    except OSError as error:
        raise CommandError(f"cannot write figures into {folder}: {error.strerror}") from None
    print("\n".join(map(str, paths)))
    return 0
