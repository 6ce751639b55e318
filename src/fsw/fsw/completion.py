"""``fsw completion``: the script by which a shell completes commands and options."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.errors import CommandError


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    text = "print the script by which a shell completes commands and options of fsw"
    parser = commands.add_parser("completion", help=text, description=f"completion: {text}.")
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="for which shell")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    try:
        import shtab
    except ImportError:
        raise CommandError("completion: shtab is missing: pip install 'fsw-control[completion]'") from None
    from fsw.main import parser

    print(shtab.complete(parser("fsw"), arguments.shell))
    return 0
