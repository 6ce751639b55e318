"""Options in the one form that they have in all commands."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw_schema.ranges import Range


def add_force(parser: argparse.ArgumentParser) -> None:
    """Add the option that lets a command replace files."""
    parser.add_argument("--force", action="store_true", help="replace files that exist")


def add_file(parser: argparse.ArgumentParser, flag: str, text: str, metavar: str = "FILE", **more: Any) -> None:
    """Add an option that takes a path."""
    parser.add_argument(flag, type=Path, metavar=metavar, help=text, **more)


def add_repeated(parser: argparse.ArgumentParser, flag: str, metavar: str, text: str, **more: Any) -> None:
    """Add an option that may be given several times; a list, empty by default."""
    parser.add_argument(flag, action="append", default=[], metavar=metavar, help=f"{text}; may be repeated", **more)


def add_number(
    parser: argparse.ArgumentParser,
    flag: str,
    metavar: str,
    allowed: Range,
    text: str,
    default: float | None = None,
    kind: type[float] = float,
) -> None:
    """Add an option that takes a number in a range, of which the error tells; ``kind`` is int for a whole number."""

    def number(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number ({allowed})") from None
        if complaint := allowed.complaint(value):
            raise argparse.ArgumentTypeError(complaint)
        return value

    parser.add_argument(flag, metavar=metavar, type=number, default=default, help=text)
