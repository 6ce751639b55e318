"""``fsw.py bag plot``: figures of welds."""

from __future__ import annotations

import argparse
from pathlib import Path

from fsw.bags import bag_argument, print_notes, welds_of
from fsw.command import FORCE, FORMAT, PICTURES, command, file, option
from fsw.errors import CommandError
from fsw.outputs import check_new
from fsw_analysis.figures import Run, draw, page
from fsw_control.schema.models import InputError
from fsw_scenario.scenario_file import parse

#: which are no folder, whatever --out takes
_OTHER_PICTURES = (".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp", ".eps", ".ps")


@command(
    "bag plot",
    "the paper's figures of a weld; several bags are overlaid",
    bag_argument(nargs="+"),
    file(
        "--out",
        f"folder for the figures (default: here), or one file ({', '.join(PICTURES)}): "
        "the overview, or the figure that --figures gives",
        "DIR",
        default=Path("."),
    ),
    option(
        "--figures",
        type=int,
        nargs="*",
        choices=range(4, 10),
        help="figures 4 to 9 (default: the scenario's)",
    ),
    FORMAT,
    FORCE,
)
def plot(arguments: argparse.Namespace) -> int:
    folder, numbers, ending = arguments.out, arguments.figures, arguments.format
    suffix = "" if folder.is_dir() else folder.suffix.lower()
    if suffix in _OTHER_PICTURES:
        raise CommandError(f"--out {folder}: the name of a figure ends in {', '.join(PICTURES)}")
    if suffix in PICTURES and suffix != f".{ending or suffix[1:]}":
        raise CommandError(f"--out {folder} contradicts --format {ending}")
    welds = welds_of(arguments.bag)
    runs = [Run(label, signals) for label, signals in welds.items()]
    if suffix in PICTURES:
        return _plot_one(runs, folder, numbers or [], arguments.force)
    text = next(iter(welds.values())).attachments.get("scenario.yaml")
    if numbers is None and text:
        try:
            numbers = parse(text.decode("utf-8", "replace"), "scenario.yaml of the bag").figures
        except InputError as error:
            print_notes([str(error)])
    names = (*(f"fig{number}" for number in numbers or ()), "overview")
    ending = ending or "png"
    check_new([folder / f"{name}.{ending}" for name in names], arguments.force)
    folder.mkdir(parents=True, exist_ok=True)
    print("\n".join(map(str, draw(runs, numbers or (), folder, ending=ending))))
    return 0


def _plot_one(runs: list[Run], file: Path, numbers: list[int], force: bool) -> int:
    if len(numbers) > 1:
        raise CommandError(f"--out {file}: one figure fits into a file; give a folder")
    check_new([file], force)
    file.parent.mkdir(parents=True, exist_ok=True)
    page(runs, numbers[0] if numbers else None, path=file)
    print(file)
    return 0
