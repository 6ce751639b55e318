"""``fsw completion``: shell script that completes commands, options, scenarios and controllers."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from fsw.command import command, option, picture_file
from fsw_control.schema.extensions import Extra
from fsw_scenario.controllers import KNOWN
from fsw_scenario.scenario_file import shipped

#: functions that complete one of some names, or a file
_FUNCTIONS = {
    "bash": """_fsw_{kind}() {{ compgen -W "{names}" -- "$1"; compgen -f -- "$1"; }}
""",
    "zsh": """_fsw_{kind}() {{ _alternative "names:{kind}:({names})" "files:file:_files" }}
""",
}


@command(
    "completion",
    "print the script by which a shell completes commands and options of fsw",
    option("shell", choices=("bash", "zsh", "tcsh"), help="for which shell"),
    needs=Extra("fsw-control", "completion", ("shtab",)),
)
def completion(arguments: argparse.Namespace) -> int:
    import shtab

    from fsw.main import parser

    values = {"scenario": shipped(), "controller": tuple(sorted(KNOWN))}
    function = _FUNCTIONS.get(arguments.shell, "")
    preamble = "".join(
        function.format(kind=kind, names=" ".join(names)) for kind, names in values.items()
    )
    commands = parser("fsw")
    for action in _actions(commands) if function else ():
        if action.dest in values:
            action.complete = {arguments.shell: f"_fsw_{action.dest}"}  # type: ignore[attr-defined]
        elif action.type in (Path, picture_file):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        if arguments.shell == "zsh" and isinstance(action.metavar, str):
            action.metavar = action.metavar.replace(":", r"\:")  # else what follows is a command
    print(shtab.complete(commands, arguments.shell, preamble={arguments.shell: preamble}))
    return 0


def _actions(parser: argparse.ArgumentParser) -> Iterable[argparse.Action]:
    """Arguments of a parser and of the commands in it."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                yield from _actions(inner)
