"""The operator's command: one parser for all commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from itertools import chain

from fsw import __version__
from fsw.command import Command, as_typed
from fsw.console import program
from fsw.errors import exit_code

_GRAPH = ("status", "reference", "disturb", "fault", "switch", "controllers", "mode", "acknowledge", "weld")
#: modules that declare commands, by their first word, in the order of the help
_MODULES = {
    **dict.fromkeys((*_GRAPH, "param", "lifecycle"), ("graph",)),
    "hmi": ("hmi",),
    "simulate": ("simulate_command",),
    "campaign": ("campaign_command",),
    "model": ("model_command",),
    "canister": ("canister",),
    "export": ("export_command",),
    "identify": ("identify_command",),
    "tune": ("tune_command",),
    "commission": ("commission",),
    "procedure": ("procedure",),
    "record": ("record_command",),
    "monitor": ("monitor",),
    "history": ("history",),
    "demo": ("demo",),
    "node": ("node",),
    "schema": ("schema_command",),
    "completion": ("completion",),
    "bag": ("bags", "bag_info", "bag_recover", "bag_kpi", "bag_plot", "bag_export", "bag_replay", "bag_evidence"),
}


def parser(name: str = "fsw.py", word: str = "") -> argparse.ArgumentParser:
    """The command line: all of it, or the commands that begin with a word, so that nothing else is imported.

    ``name`` is what the user has typed, ``fsw`` where the package is installed.
    """
    whole = argparse.ArgumentParser(
        prog=name,
        description="Monitor and control friction stir welds, simulate welds, analyse their bags.",
        epilog="Units: mm, degC, kN, rpm, N m, kW, s. '%(prog)s COMMAND --help' lists the ranges.",
    )
    whole.add_argument("--version", action="version", version=f"fsw-control {__version__}")
    places = {"": _places(whole)}
    for module in _MODULES.get(word) or dict.fromkeys(chain.from_iterable(_MODULES.values())):
        for one in vars(import_module(f"fsw.{module}")).values():
            if isinstance(one, Command):
                before, _, last = one.name.rpartition(" ")
                description = as_typed(one.description)
                added = places[before].add_parser(
                    last,
                    help=as_typed(one.text),
                    description=description,
                    usage=one.usage,
                    allow_abbrev=False,  # --dept might move an actuator
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
    words = sys.argv[1:] if arguments is None else list(arguments)
    parsed = parser(program(), words[0] if words else "").parse_args(words)
    return exit_code(lambda: parsed.run(parsed))


if __name__ == "__main__":
    sys.exit(main())
