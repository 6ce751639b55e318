"""``fsw.py bag verify`` and ``shadow``: replay of recorded welds to controllers."""

from __future__ import annotations

import argparse
from math import inf
from pathlib import Path

from fsw.bags import bag_argument, print_notes
from fsw.command import (
    command,
    file,
    number,
    option,
    parameter,
    parameters_by_node,
    switch,
)
from fsw.console import ProgressBar, check_new, write_json
from fsw.errors import CommandError
from fsw_analysis.messages import WeldMessages
from fsw_control.schema.models import InputError
from fsw_control.schema.ranges import Range
from fsw_lab.replay import replay
from fsw_lab.shadow import write_shadow
from fsw_plant.event_schema import DURATION_S
from fsw_scenario.controllers import described_in, maker, name_of, with_variant

#: help text on names of controllers
_NAME_OR_CLASS = "NAME, or MODULE:CLASS or FILE.py:CLASS of your own controller"
#: differences from the conversion of units, or another processor (about 1e-12), count as equal; an
#: operator could notice 1e-4
_TOLERANCE = 1e-9
#: exit code if all replayed controllers agree, but one of the bag could not be replayed
_LEFT_OUT = 3
#: exit code if proposals differ, but only of controllers whose inputs are uncertain
_NOT_COMPARABLE = 4


def read_messages(bag: Path) -> WeldMessages:
    """Messages of the weld in a bag; problems of the bag are reported on stderr."""
    with ProgressBar(f"reading {bag}") as bar:
        messages = WeldMessages(bag, bar)
    print_notes(messages.problems)
    return messages


@command(
    "bag verify",
    "replay controllers on a bag and compare with the recorded proposals",
    bag_argument("bag of a weld, recorded from its start"),
    option(
        "--controller",
        action="append",
        metavar="NAME",
        help=f"replay this one: {_NAME_OR_CLASS}; may be repeated (default: all in the bag)",
    ),
    number(
        "--tolerance",
        "X",
        Range(0.0, inf, ""),
        "commands count as equal that differ by up to X (1 + recorded value), in kN or rpm; "
        "0: bit by bit "
        f"(default: {_TOLERANCE:g}, more than another kind of processor changes)",
        _TOLERANCE,
    ),
    description="Drive controllers by a bag instead of the clock "
    "and compare their proposals with the recorded "
    "ones. Exit code 0: all equal; 1: they differ, or the bag cannot be replayed; "
    f"{_LEFT_OUT}: equal, but a controller of the bag is unknown here and was skipped; "
    f"{_NOT_COMPARABLE}: they differ and cannot be compared, "
    "as the bag begins in mid-weld or its stamps go back.",
)
def verify(arguments: argparse.Namespace) -> int:
    messages = read_messages(arguments.bag)
    recorded = list(messages.controllers("proposal"))
    names = [name_of(label) for label in arguments.controller or ()]
    if not recorded or not set(names) <= set(recorded):
        raise CommandError(
            f"{arguments.bag}: no proposals of {', '.join(names) or 'any controller'} in this bag"
        )
    code, any_replayed = 0, False
    for name in dict.fromkeys(names or recorded):
        try:
            make, described = maker(name), described_in(name)
        except InputError as error:
            print_notes([f"{name} is left out: {error}"])
            code = code or _LEFT_OUT
            continue
        replayed = replay(messages, name, make, described)
        result = replayed.against_own(name, arguments.tolerance)
        print_notes(replayed.notes)
        decided = replayed.comparable or not result.beyond
        print(
            "\n".join(result.lines() if decided else [f"{name}: cannot be compared"]), flush=True
        )
        if result.beyond and code != 1:
            code = 1 if replayed.comparable else _NOT_COMPARABLE
        any_replayed = True
    if not any_replayed:
        raise CommandError(f"{arguments.bag}: nothing could be replayed")
    return code


@command(
    "bag shadow",
    "replay a weld to a controller and compare its proposals with the applied commands",
    bag_argument(),
    option("--controller", metavar="NAME", required=True, help=_NAME_OR_CLASS),
    number("--duration", "S", DURATION_S, "only the first seconds of the weld", inf),
    parameter("parameter of the controller, instead of the recorded one or the default"),
    file("--out", "folder for the new bag (default: <bag>_shadow_<controller>)", "DIR"),
    file("--json", "also write the differences as JSON"),
    switch("--force", "replace the file of --json; a bag is never replaced"),
    description="Replay the measurements, set-points and commands of a bag "
    "to a controller in shadow, record its "
    "proposals and compare them with the commands applied in the weld.",
)
def shadow(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    source, label = arguments.bag, arguments.controller
    name, make = name_of(label), maker(label)
    given = parameters_by_node(arguments.parameter, [name]).get(name, {})
    changed = with_variant(label, given)
    folder = arguments.out or source.absolute().parent / f"{source.absolute().name}_shadow_{name}"
    if folder.exists():
        raise CommandError(f"{folder}: exists already; give another folder with --out")
    messages = read_messages(source)
    result = replay(messages, name, make, described_in(label), changed, arguments.duration)
    print_notes(result.notes)
    unhealthy = sum(not proposal.healthy for proposal in result.proposals)
    print(f"{name} in shadow: {len(result.stamps)} ticks replayed, {unhealthy} not healthy")
    comparisons = [result.against_applied("compared with the applied commands", _TOLERANCE)]
    if name in messages.controllers("proposal"):
        comparisons.append(
            result.against_own("compared with its own recorded proposals", _TOLERANCE)
        )
    for comparison in comparisons:
        print("\n".join(comparison.lines()))
    write_shadow(result, source, messages.namespace, folder)
    print(f"proposals recorded in {folder}")
    values = {"controller": name, "ticks": len(result.stamps), "unhealthy": unhealthy}
    write_json(arguments.json, {**values, "comparisons": [item.values() for item in comparisons]})
    return 0
