"""The operator's command: one parser for all commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from fsw import __version__
from fsw.console import program
from fsw.errors import exit_code

#: the commands for a running weld, in the order of the help
RUNNING = (
    "status",
    "reference",
    "disturb",
    "fault",
    "switch",
    "controllers",
    "mode",
    "acknowledge",
    "weld",
    "param",
    "lifecycle",
    "hmi",
)
_COMMANDS = (
    *(
        *RUNNING,
        "simulate",
        "campaign",
        "model",
        "canister",
        "export",
        "identify",
        "tune",
        "commission",
        "procedure",
        "record",
    ),
    *("monitor", "history", "demo", "node", "completion"),
)
#: modules of the commands whose name is that of a function of the package
_MODULES = {
    name: f"{name}_command" for name in ("simulate", "campaign", "model", "export", "identify", "tune", "record")
} | {"param": "params"}
_BAG_COMMANDS = ("info", "recover", "kpi", "plot", "export", "verify", "shadow", "keygen", "attest", "verify-evidence")


def parser(name: str = "fsw.py", only: str = "") -> argparse.ArgumentParser:
    """The whole command line, or that of one command: modules of the others need not be imported.

    ``name`` is what the user has typed, ``fsw`` where the package is installed.
    """
    whole = argparse.ArgumentParser(
        prog=name,
        description="Monitor and control friction stir welds, simulate welds, analyse their bags.",
        epilog="Units: mm, degC, kN, rpm, N m, kW, s. '%(prog)s COMMAND --help' lists the ranges.",
    )
    whole.add_argument("--version", action="version", version=f"fsw-control {__version__}")
    commands = whole.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in _COMMANDS:
        if only in (name, ""):
            import_module(f"fsw.{_MODULES.get(name, name)}").add_command(commands)
    if only not in ("bag", ""):
        return whole
    bag = commands.add_parser("bag", help="inspect recorded welds", description="Inspect recorded welds.")
    bag_commands = bag.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in _BAG_COMMANDS:
        import_module(f"fsw.bag_{name.replace('-', '_')}").add_command(bag_commands)
    return whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code, which is 2 for wrong arguments."""
    words = sys.argv[1:] if arguments is None else [*arguments]
    only = words[0] if words and words[0] in (*_COMMANDS, "bag") else ""
    parsed = parser(program(), only).parse_args(words)
    return exit_code(lambda: int(parsed.run(parsed)))


if __name__ == "__main__":
    sys.exit(main())
