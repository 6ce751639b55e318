"""The operator's command: one parser for all commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from fsw import __version__
from fsw.command import Command, as_typed
from fsw.console import program
from fsw.errors import exit_code

#: modules that declare commands, in the order of the help
_MODULES = (
    *("graph", "hmi", "simulate_command", "campaign_command", "model_command", "canister", "export_command"),
    *("identify_command", "tune_command", "commission", "procedure", "record_command", "monitor", "history"),
    *("demo", "node", "completion", "bags", "bag_info", "bag_recover", "bag_kpi", "bag_plot", "bag_export"),
    *("bag_replay", "bag_evidence"),
)


def parser(name: str = "fsw.py") -> argparse.ArgumentParser:
    """The whole command line; ``name`` is what the user has typed, ``fsw`` where the package is installed."""
    whole = argparse.ArgumentParser(
        prog=name,
        description="Monitor and control friction stir welds, simulate welds, analyse their bags.",
        epilog="Units: mm, degC, kN, rpm, N m, kW, s. '%(prog)s COMMAND --help' lists the ranges.",
    )
    whole.add_argument("--version", action="version", version=f"fsw-control {__version__}")
    places = {"": _places(whole)}
    for module in _MODULES:
        for one in vars(import_module(f"fsw.{module}")).values():
            if isinstance(one, Command):
                before, _, last = one.name.rpartition(" ")
                description = as_typed(one.description)
                added = places[before].add_parser(
                    last, help=as_typed(one.text), description=description, usage=one.usage
                )
                if one.run is None:
                    places[one.name] = _places(added)
                for add in one.options:
                    add(added)
                added.set_defaults(run=one, verb=last)
    return whole


def _places(parser: argparse.ArgumentParser) -> argparse._SubParsersAction[argparse.ArgumentParser]:
    return parser.add_subparsers(title="commands", metavar="COMMAND", required=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code, which is 2 for wrong arguments."""
    parsed = parser(program()).parse_args(arguments)
    return exit_code(lambda: parsed.run(parsed))


if __name__ == "__main__":
    sys.exit(main())
