"""``fsw.py bag shadow``: a recorded weld replayed to a controller in shadow."""

from __future__ import annotations

import argparse
from math import inf
from typing import Any

from fsw.bags import NAME_OR_CLASS, add_bag_command, print_notes, read_messages
from fsw.errors import CommandError
from fsw.options import add_file, add_force, add_number, add_repeated
from fsw.outputs import check_new, write_json
from fsw.simulate_command import assignment
from fsw_analysis.replay import replay
from fsw_analysis.shadow import write_shadow
from fsw_plant.event_schema import DURATION_S
from fsw_scenario.controllers import described_in, maker, name_of, variant_of

#: what only the conversion to the units of the wire changes counts as equal
_TOLERANCE = 1e-9


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    shadow = add_bag_command(
        commands,
        "shadow",
        _run,
        "replay a weld to a controller and compare its proposals with the applied commands",
        description="Replay the measurements, set-points and commands of a bag to a controller in shadow, record its "
        "proposals and compare them with the commands applied in the weld.",
    )
    shadow.add_argument("--controller", metavar="NAME", required=True, help=NAME_OR_CLASS)
    add_number(shadow, "--duration", "S", DURATION_S, "only the first seconds of the weld", inf)
    text = "parameter of the controller, instead of the recorded one or the default"
    add_repeated(shadow, "--set", "NAME=VALUE", text, dest="parameters")
    add_file(shadow, "--out", "folder for the new bag (default: <bag>_shadow_<controller>)", "DIR")
    add_file(shadow, "--json", "also write the differences as JSON")
    add_force(shadow)


def _run(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    source, label = arguments.bag, arguments.controller
    name, make = name_of(label), maker(label)
    changed = {**variant_of(label), **dict(assignment("--set", text) for text in arguments.parameters)}
    folder = arguments.out or source.absolute().parent / f"{source.absolute().name}_shadow_{name}"
    if folder.exists():
        raise CommandError(f"{folder}: exists already; give another folder with --out")
    messages = read_messages(source)
    result = replay(messages, name, make, described_in(label), changed, arguments.duration)
    print_notes(result.notes)
    unhealthy = sum(not one.healthy for one in result.proposals)
    print(f"{name} in shadow: {len(result.stamps)} ticks replayed, {unhealthy} not healthy")
    comparisons = [result.against_applied("compared with the applied commands", _TOLERANCE)]
    if name in messages.controllers("proposal"):
        comparisons.append(result.against_own("compared with its own recorded proposals", _TOLERANCE))
    for one in comparisons:
        print("\n".join(one.lines()))
    write_shadow(result, source, messages.namespace, folder)
    print(f"proposals recorded in {folder}")
    values = {"controller": name, "ticks": len(result.stamps), "unhealthy": unhealthy}
    write_json(arguments.json, {**values, "comparisons": [one.values() for one in comparisons]})
    return 0
