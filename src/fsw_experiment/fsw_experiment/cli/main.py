"""The operator's command: one parser, one place where errors become one line."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from fsw_analysis.kpi import KpiError
from fsw_control.free_domain import NoFreeDomainError
from fsw_control.parameters import ParameterError
from fsw_experiment.cli import bags, model, operate, replays, simulate
from fsw_experiment.cli.errors import CommandError
from fsw_experiment.launcher import LaunchError
from fsw_experiment.scenario import ScenarioError
from fsw_recorder.errors import BagError


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    whole = argparse.ArgumentParser(
        prog="fsw.py",
        description="Look at and steer a friction stir weld, simulate welds, analyse their bags.",
        epilog="Units: mm, degC, kN, rpm, N m, kW, s. 'fsw.py COMMAND --help' lists the ranges.",
    )
    commands = whole.add_subparsers(title="commands", metavar="COMMAND", required=True)
    operate.add_commands(commands)
    simulate.add_command(commands)
    model.add_command(commands)
    bag = commands.add_parser("bag", help="look at recorded welds", description="Look at recorded welds.")
    bag_commands = bag.add_subparsers(title="commands", metavar="COMMAND", required=True)
    bags.add_commands(bag_commands)
    replays.add_commands(bag_commands)
    return whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code: 0 done, 1 not possible, 2 wrong arguments, 130 interrupted."""
    try:
        parsed = parser().parse_args(arguments)
        code = int(parsed.run(parsed))
        sys.stdout.flush()
        return code
    except (CommandError, ScenarioError, ParameterError, BagError, KpiError, LaunchError, NoFreeDomainError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # whoever read our output has seen enough; nothing is left to be flushed at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


if __name__ == "__main__":
    sys.exit(main())
