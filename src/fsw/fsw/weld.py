"""``fsw.py weld``: run a weld; hold and resume a programme; abort. `weld_ros` carries it out."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_verbs
from fsw.options import add_repeated

_VERBS = {
    "run": "run a scenario in the running graph and follow it; the weld goes on if this command is ended",
    "hold": "stop the travel of the programme and keep the set-points in force",
    "resume": "go back to the programme by a ramp",
    "abort": "give the weld up; a safe stop is requested until the supervisor answers",
}


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    one = add_verbs(commands, "weld", "run a weld; hold, resume or abort it", _VERBS, _run)["run"]
    one.add_argument("scenario", metavar="SCENARIO", help="YAML file, or name of a shipped scenario")
    add_repeated(one, "--set", "KEY=VALUE", "replace a value of the scenario, e.g. controller=nmpc")


def _run(arguments: argparse.Namespace) -> int:
    from fsw import weld_ros  # the other commands do without rclpy

    return weld_ros.run(arguments)
