"""``fsw.py learn``: the heat over the path of a type of weld, from recorded welds of it."""

from __future__ import annotations

import argparse
from pathlib import Path

from fsw.bags import data_sha256, read_weld
from fsw.command import FORCE, command, file, option, switch
from fsw.console import ProgressBar, check_new, print_table, write_text
from fsw.errors import CommandError
from fsw_analysis.changes import cut_to_scenario
from fsw_identification.heat_learning import Learned, learn
from fsw_lab.heat_update import check_heat, check_record, check_type, earlier_bags
from fsw_lab.identify_command import DRIVE_LAG
from fsw_model import ModelParameters
from fsw_model.heat_profile import HeatProfile

#: welds of a profile that is updated: one is nearly as good as eight, and each takes seconds
MOST_WELDS = 8


@command(
    "learn",
    "heat over the path of a type of weld, from bags of such welds",
    option("bag", type=Path, nargs="+", help="bag of a weld of the type"),
    option("--type", metavar="NAME", help="name of the type: canister, tool, path"),
    file(
        "--update",
        "heat profile of the type: add the bag of an accepted weld to it, "
        f"with its last {MOST_WELDS} welds, whose bags are beside this one",
    ),
    file("--out", "heat profile (YAML; default NAME.heat.yaml)"),
    file("--model-out", "model file that belongs to it (YAML; default NAME.model.yaml)"),
    file("--model", "model of the process (default: the paper's)"),
    switch("--keep-model", "keep gain, lags and dead time of the model"),
    switch("--computed", "bags of simulated welds"),
    DRIVE_LAG,
    FORCE,
    description="Find the heat into the copper beyond the spindle's power in each weld, by place, "
    "and write its mean with its standard deviation as a heat profile, "
    "and the model file with which the NMPC takes it.",
)
def learn_type(arguments: argparse.Namespace) -> int:
    if (arguments.type is None) == (arguments.update is None):
        raise CommandError("learn: give --type, or the profile of one by --update")
    if arguments.computed and arguments.update is not None:
        raise CommandError("learn --update: adds a weld that was made, so --computed goes without")
    return _learn(arguments) if arguments.update is None else _update(arguments)


def _learn(arguments: argparse.Namespace) -> int:
    out = arguments.out or Path(f"{arguments.type}.heat.yaml")
    model_out = arguments.model_out or Path(f"{arguments.type}.model.yaml")
    check_new([out, model_out], arguments.force)
    model = (
        ModelParameters()
        if arguments.model is None
        else ModelParameters.from_file(arguments.model)
    )
    welds = [
        (bag.name, data_sha256(bag), cut_to_scenario(read_weld(bag))) for bag in arguments.bag
    ]
    with ProgressBar("learning") as bar:
        learned = learn(
            welds,
            arguments.type,
            model,
            arguments.drive_lag,
            arguments.keep_model,
            arguments.computed,
            bar,
        )
    _print(learned)
    write_text(out, learned.profile.text)
    write_text(model_out, model_text(learned))
    print(f"written: {out}, {model_out}")
    return 0


def _update(arguments: argparse.Namespace) -> int:
    """Learn again from the profile's last welds and an accepted one, with the profile's model."""
    if len(arguments.bag) > 1:
        raise CommandError("learn --update: adds one weld; give one bag")
    (bag,), file = arguments.bag, arguments.update
    profile = HeatProfile.from_file(file)
    check_record(bag, profile)
    bags = [*earlier_bags(profile, bag.parent, MOST_WELDS - 1).values(), bag]
    welds = [(bag.name, data_sha256(bag), cut_to_scenario(read_weld(bag))) for bag in bags]
    *earlier, weld = (signals for _, _, signals in welds)
    check_type(weld, earlier)
    model = (
        ModelParameters().changed(**profile.model.model_dump())
        if arguments.model is None
        else ModelParameters.from_file(arguments.model)
    )
    with ProgressBar("learning") as bar:
        learned = learn(
            welds, profile.type, model, arguments.drive_lag, keep_model=True, progress=bar
        )
    _print(learned)
    check_heat(profile, learned.profile)
    write_text(arguments.out or file, learned.profile.text)
    print(f"written: {arguments.out or file}")
    return 0


def model_text(learned: Learned) -> str:
    """YAML of what the model of a profile has other than the default one."""
    default = ModelParameters()
    changed = {
        name: value for name, value in learned.model if value != getattr(default, name)
    } or {"copper_lag_s": learned.model.copper_lag_s}
    title = (
        f"# Model that belongs to the heat profile {learned.profile.type}, by 'fsw.py learn'.\n"
    )
    return title + "".join(f"{name}: {value!r}\n" for name, value in changed.items())


def _print(learned: Learned) -> None:
    profile, model = learned.profile, learned.model
    rows = [
        (
            source.weld,
            source.sha256[:12],
            "-" if source.left_out_kw is None else f"{source.left_out_kw:.2f}",
        )
        for source in profile.welds
    ]
    print_table(rows, ("weld", "SHA-256", "lacking when left out [kW]"), words=2)
    print(
        f"copper: {model.thermal_gain_c_per_kw:.3g} degC/kW, {model.copper_lag_s:.3g} s, "
        f"tool {model.tool_lag_s:.3g} s, dead time {model.dead_time_s:.3g} s; "
        f"heat: {min(profile.heat_kw):.2f} to {max(profile.heat_kw):.2f} kW over "
        f"{profile.travel_mm[-1]:.0f} mm, wandering by {learned.walk.heat_kw:.2g} "
        "kW per root second"
    )
