"""The command line: one parser for all commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from types import ModuleType
from typing import Any

from fsw import __version__, missing
from fsw.command import Command, as_typed
from fsw.errors import exit_code, program
from fsw_control.schema.errors import InputError
from fsw_control.schema.extensions import extensions, loaded

#: entry points: modules that declare commands, by their first word; a suffix after a dot only
#: distinguishes them
GROUP = "fsw.commands"
#: options that need no command
_OPTIONS = ("-h", "--help", "--version")


def parser(name: str = "fsw.py", word: str = "") -> argparse.ArgumentParser:
    """Parser of all commands, or of those that begin with a word, to import nothing else.

    ``name`` is the program as typed by the user, ``fsw`` if the package is installed.
    """
    whole = _Parser(
        prog=name,
        description="Monitor and control friction stir welds, simulate welds, analyse their bags.",
        epilog="Units: mm, degC, kN, rpm, N m, kW, s. '%(prog)s COMMAND --help' lists the ranges.",
    )
    whole.add_argument("--version", action="version", version=f"fsw-control {__version__}")
    places = {"": _places(whole)}
    for module in _modules(word):
        for command in vars(module).values():
            if isinstance(command, Command):
                before, _, last = command.name.rpartition(" ")
                description = as_typed(command.description)
                added = places[before].add_parser(
                    last,
                    help=as_typed(command.text),
                    description=description,
                    usage=command.usage,
                    allow_abbrev=False,  # --dept might move an actuator
                )
                if command.run is None:
                    places[command.name] = _places(added)
                for add in command.options:
                    add(added)
                added.set_defaults(run=command, verb=last, parser=added)
    return whole


def _modules(word: str) -> Iterable[ModuleType]:
    """Modules whose commands begin with a word, e.g. ``bag`` and ``bag.info``; all if none does.

    A module of another distribution that cannot be imported is skipped with a note, unless it is
    the requested one.
    """
    if word == "--version":  # it needs no command
        return ()
    names = list(extensions(GROUP))
    matching = [name for name in names if name.partition(".")[0] == word]
    modules: dict[str, ModuleType] = {}
    for name in matching or names:
        try:
            module = loaded(GROUP, name)
        except InputError as error:
            if matching:
                raise
            print(f"note: {error}", file=sys.stderr)
            continue
        modules.setdefault(module.__name__, module)
    return modules.values()


class _Parser(argparse.ArgumentParser):
    """Names the command that may have been meant, as argparse does from Python 3.14 on."""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if isinstance(action, argparse._SubParsersAction) and value not in action.choices:
            group = self.prog.removeprefix(program()).strip()
            self.error(_unknown(group, value, action.choices))
        super()._check_value(action, value)


def _places(
    parser: argparse.ArgumentParser,
) -> argparse._SubParsersAction[argparse.ArgumentParser]:
    return parser.add_subparsers(title="commands", metavar="COMMAND", required=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code, 2 for invalid arguments."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    if words[:1] == ["help"]:
        words = [*words[1:], "--help"]

    def run() -> int:
        word = words[0] if words else ""
        known = {name.partition(".")[0] for name in extensions(GROUP)} | {*_OPTIONS}
        if word and word not in known:
            short = argparse.ArgumentParser(prog=program(), usage="%(prog)s COMMAND ...")
            short.error(_unknown("", word, known))
        parsed, surplus = parser(program(), word).parse_known_args(words)
        if surplus:
            options = parsed.parser._option_string_actions
            nearest = _nearest(surplus[0].partition("=")[0], options)
            parsed.parser.error(f"unrecognized arguments: {' '.join(surplus)}{nearest}")
        code: int = parsed.run(parsed)
        return code

    return exit_code(run)


def _unknown(group: str, word: str, known: Iterable[str]) -> str:
    """Error of an unknown command: what may have been meant, and what to install."""
    name = f"{group} {word}".strip()
    return f"unknown command {name}{_nearest(word, known) or missing(extensions(GROUP))}"


def _nearest(word: str, known: Iterable[str]) -> str:
    """Which known word may have been meant, as a continuation of an error message."""
    names = {name.lstrip("-"): name for name in known}
    likely = get_close_matches(word.lstrip("-"), names, 1)
    return f"; did you mean {names[likely[0]]}?" if likely else ""


if __name__ == "__main__":
    sys.exit(main())
