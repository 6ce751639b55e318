"""``fsw completion``: the script by which a shell completes commands and options."""

from __future__ import annotations

import argparse

from fsw.command import command, option
from fsw.errors import CommandError


@command(
    "completion",
    "print the script by which a shell completes commands and options of fsw",
    option("shell", choices=("bash", "zsh", "tcsh"), help="for which shell"),
)
def completion(arguments: argparse.Namespace) -> int:
    try:
        import shtab
    except ImportError:
        raise CommandError("completion: shtab is missing: pip install 'fsw-control[completion]'") from None
    from fsw.main import parser

    print(shtab.complete(parser("fsw"), arguments.shell))
    return 0
