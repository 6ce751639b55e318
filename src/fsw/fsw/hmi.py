"""``fsw.py hmi user``: who may command by the operator's page."""

from __future__ import annotations

import argparse
import getpass
import sys
from pathlib import Path
from typing import Any

from fsw.console import print_table
from fsw.errors import CommandError
from fsw_hmi.users import LONGEST, NAME_RULE, ROLES, SHORTEST, User, checked_name, new_user, read, write

_VERBS = {
    "add": "add a user; the password comes from a prompt, or from stdin in a pipe",
    "passwd": "change a user's password, from a prompt or from stdin, and with --role the role",
    "remove": "remove a user",
    "list": "names and roles of all users",
}
_ROLES = "view: look and safe stop; operate: command the weld, too; engineer: disturb the emulator, too"


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    text = "the operator's page: who may command by it"
    hmi = commands.add_parser("hmi", help=text, description=f"hmi: {text}.")
    user = hmi.add_subparsers(title="commands", metavar="COMMAND", required=True)
    text = "named users in a file of salted hashes, for users_file of the page's server"
    verbs = user.add_parser("user", help=text, description=f"user: {text}.")
    verb_commands = verbs.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for verb, words in _VERBS.items():
        one = verb_commands.add_parser(verb, help=words, description=f"{verb}: {words}.")
        if verb != "list":
            one.add_argument("name", metavar="NAME", help=NAME_RULE)
        if verb in ("add", "passwd"):
            one.add_argument("--role", choices=ROLES, required=verb == "add", help=_ROLES)
        one.add_argument("--file", type=Path, required=True, metavar="FILE", help="the users, for its owner alone")
        one.set_defaults(run=_run, verb=verb)


def _run(arguments: argparse.Namespace) -> int:
    path, verb = arguments.file, arguments.verb
    try:
        users = [] if verb == "add" and not path.exists() else read(path)
        if verb == "list":
            print_table([(user.name, user.role) for user in users], ("name", "role"))
            return 0
        write(path, _changed(users, arguments))
    except ValueError as error:
        raise CommandError(str(error)) from None
    print(f"{arguments.name} {'removed from' if verb == 'remove' else 'written to'} {path}: restart the page's server")
    return 0


def _changed(users: list[User], arguments: argparse.Namespace) -> list[User]:
    """All users after the command."""
    name, verb = arguments.name, arguments.verb
    before = next((user for user in users if user.name.casefold() == name.casefold()), None)
    if verb == "add" and before is not None:
        raise CommandError(f"{arguments.file} has {before.name} already; 'passwd' changes the password")
    if verb != "add" and before is None:
        known = ", ".join(user.name for user in users) or "nobody"
        raise CommandError(f"{arguments.file} has no {name!r}; it has {known}")
    checked_name(name)
    if verb == "remove":
        return [user for user in users if user is not before]
    name, role = (before.name, arguments.role or before.role) if before else (name, arguments.role)
    after = new_user(name, role, _password(name))
    return [after if user is before else user for user in users] + ([] if before else [after])


def _password(name: str) -> str:
    """The password from a prompt, twice, or the first line of stdin."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\r\n")
    password = getpass.getpass(f"Password of {name} ({SHORTEST} to {LONGEST} characters): ")
    if getpass.getpass("Again: ") != password:
        raise CommandError("the two passwords differ; nothing is changed")
    return password
