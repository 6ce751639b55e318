"""``fsw.py bag plot``: figures of welds."""

from __future__ import annotations

import argparse
from pathlib import Path

from fsw.bags import bag_argument, print_notes, welds_of
from fsw.command import FORCE, command, file, option
from fsw.outputs import check_new
from fsw_analysis.figures import Run, draw
from fsw_control.schema.models import InputError
from fsw_scenario.scenario_file import parse


@command(
    "bag plot",
    "the paper's figures of a weld; several bags are overlaid",
    bag_argument(nargs="+"),
    file("--out", "folder for the PNG files (default: here)", "DIR", default=Path(".")),
    option(
        "--figures",
        type=int,
        nargs="*",
        choices=range(4, 10),
        help="figures 4 to 9 (default: the scenario's)",
    ),
    FORCE,
)
def plot(arguments: argparse.Namespace) -> int:
    welds, folder, numbers = welds_of(arguments.bag), arguments.out, arguments.figures
    text = next(iter(welds.values())).attachments.get("scenario.yaml")
    if numbers is None and text:
        try:
            numbers = parse(text.decode("utf-8", "replace"), "scenario.yaml of the bag").figures
        except InputError as error:
            print_notes([str(error)])
    names = (*(f"fig{one}" for one in numbers or ()), "overview")
    check_new([folder / f"{name}.png" for name in names], arguments.force)
    folder.mkdir(parents=True, exist_ok=True)
    paths = draw([Run(label, signals) for label, signals in welds.items()], numbers or (), folder)
    print("\n".join(map(str, paths)))
    return 0
