"""``fsw completion``: shell script that completes commands and options."""

from __future__ import annotations

import argparse

from fsw.command import command, option
from fsw_control.schema.extras import Extra


@command(
    "completion",
    "print the script by which a shell completes commands and options of fsw",
    option("shell", choices=("bash", "zsh", "tcsh"), help="for which shell"),
    needs=Extra("fsw-control", "completion", ("shtab",)),
)
def completion(arguments: argparse.Namespace) -> int:
    import shtab

    from fsw.main import parser

    print(shtab.complete(parser("fsw"), arguments.shell))
    return 0
