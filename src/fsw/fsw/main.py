"""The operator's command: one parser for all commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from fsw import bags, campaign, export, identify, model, operate, params, replays, simulate, tune
from fsw.errors import exit_code


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    whole = argparse.ArgumentParser(
        prog="fsw.py",
        description="Look at and steer a friction stir weld, simulate welds, analyse their bags.",
        epilog="Units: mm, degC, kN, rpm, N m, kW, s. 'fsw.py COMMAND --help' lists the ranges.",
    )
    commands = whole.add_subparsers(title="commands", metavar="COMMAND", required=True)
    operate.add_commands(commands)
    params.add_command(commands)
    simulate.add_command(commands)
    campaign.add_command(commands)
    model.add_command(commands)
    export.add_command(commands)
    identify.add_command(commands)
    tune.add_command(commands)
    bag = commands.add_parser("bag", help="look at recorded welds", description="Look at recorded welds.")
    bag_commands = bag.add_subparsers(title="commands", metavar="COMMAND", required=True)
    bags.add_commands(bag_commands)
    replays.add_commands(bag_commands)
    return whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code, which is 2 for wrong arguments."""
    parsed = parser().parse_args(arguments)
    return exit_code(lambda: int(parsed.run(parsed)))


if __name__ == "__main__":
    sys.exit(main())
