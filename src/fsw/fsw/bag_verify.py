"""``fsw.py bag verify``: controllers replayed on a recorded weld."""

from __future__ import annotations

import argparse
from math import inf
from typing import Any

from fsw.bags import NAME_OR_CLASS, add_bag_command, print_notes, read_messages
from fsw.errors import CommandError
from fsw.options import add_number
from fsw_analysis.replay import replay
from fsw_scenario.controllers import described_in, maker, name_of
from fsw_schema.models import InputError
from fsw_schema.ranges import Range

#: another processor changes a command by about 1e-12; an operator could notice 1e-4
_TOLERANCE = 1e-9
#: exit code when all replayed controllers agree, but one of the bag could not be replayed
_LEFT_OUT = 3
#: exit code when proposals differ, but only those of controllers whose state at the beginning is unknown
_NOT_COMPARABLE = 4


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    check = add_bag_command(
        commands,
        "verify",
        _run,
        "replay controllers on a bag and compare with the recorded proposals",
        "bag of a weld, recorded from its start",
        "Drive controllers by a bag instead of the clock and compare their proposals with the recorded "
        "ones. Exit code 0: all equal; 1: they differ, or the bag cannot be replayed; "
        f"{_LEFT_OUT}: equal, but a controller of the bag is unknown here and was skipped; "
        f"{_NOT_COMPARABLE}: they differ and cannot be compared, as the bag begins in mid-weld.",
    )
    check.add_argument(
        "--controller",
        action="append",
        metavar="NAME",
        help=f"replay this one: {NAME_OR_CLASS}; may be repeated (default: all in the bag)",
    )
    text = (
        "commands count as equal that differ by up to X (1 + recorded value), in kN or rpm; 0: bit by bit "
        f"(default: {_TOLERANCE:g}, more than another kind of processor changes)"
    )
    add_number(check, "--tolerance", "X", Range(0.0, inf, ""), text, _TOLERANCE)


def _run(arguments: argparse.Namespace) -> int:
    messages = read_messages(arguments.bag)
    recorded = list(messages.controllers("proposal"))
    names = [name_of(label) for label in arguments.controller or ()]
    if not recorded or not set(names) <= set(recorded):
        raise CommandError(f"{arguments.bag}: no proposals of {', '.join(names) or 'any controller'} in this bag")
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
        print("\n".join(result.lines()), flush=True)
        if result.beyond and code != 1:
            code = 1 if replayed.comparable else _NOT_COMPARABLE
        any_replayed = True
    if not any_replayed:
        raise CommandError(f"{arguments.bag}: nothing could be replayed")
    return code
