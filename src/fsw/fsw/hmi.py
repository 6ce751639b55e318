"""``fsw.py hmi user``: named users of the operator page."""

from __future__ import annotations

import argparse
import getpass
import sys
from typing import TYPE_CHECKING

from fsw.command import command, file, group, option
from fsw.console import print_table
from fsw.errors import CommandError
from fsw_hmi.main import EXTRA

if TYPE_CHECKING:  # from the extra hmi
    from fsw_hmi.users import User

HMI = group("hmi", "the operator's page: who may command by it")


@command(
    "hmi user",
    "named users in a file of salted hashes, for users_file of the page's server",
    option("action", choices=("add", "passwd", "remove", "list"), help="passwd: a new password"),
    option("name", metavar="NAME", nargs="?", default="", help="the user; not for list"),
    file("--file", "the users, for its owner alone", required=True),
    description="Passwords come from a prompt, or from stdin in a pipe.",
    needs=EXTRA,
)
def user(arguments: argparse.Namespace) -> int:
    from fsw_hmi.users import read, write

    path, verb = arguments.file, arguments.action
    if (verb == "list") == bool(arguments.name):
        raise CommandError(f"hmi user {verb}: give {'no' if arguments.name else 'a'} NAME")
    try:
        users = [] if verb == "add" and not path.exists() else read(path)
        if verb == "list":
            print_table([(user.name,) for user in users], ("name",))
            return 0
        write(path, _changed(users, arguments))
    except ValueError as error:
        raise CommandError(str(error)) from None
    print(
        f"{arguments.name} {'removed from' if verb == 'remove' else 'written to'} {path}: "
        "restart the page's server"
    )
    return 0


def _changed(users: list[User], arguments: argparse.Namespace) -> list[User]:
    """All users after the command."""
    from fsw_hmi.users import checked_name, new_user

    name, verb = arguments.name, arguments.action
    before = next((user for user in users if user.name.casefold() == name.casefold()), None)
    if verb == "add" and before is not None:
        raise CommandError(
            f"{arguments.file} has {before.name} already; 'passwd' changes the password"
        )
    if verb != "add" and before is None:
        known = ", ".join(user.name for user in users) or "nobody"
        raise CommandError(f"{arguments.file} has no {name!r}; it has {known}")
    checked_name(name)
    if verb == "remove":
        return [user for user in users if user is not before]
    after = new_user(before.name if before else name, _password(name))
    return [after if user is before else user for user in users] + ([] if before else [after])


def _password(name: str) -> str:
    """The password from a prompt, twice, or the first line of stdin."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\r\n")
    password = getpass.getpass(f"Password of {name}: ")
    if getpass.getpass("Again: ") != password:
        raise CommandError("the two passwords differ; nothing is changed")
    return password
