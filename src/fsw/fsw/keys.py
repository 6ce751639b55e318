"""Shared by the commands that sign and verify."""

from __future__ import annotations

import argparse
from pathlib import Path

from fsw.console import program
from fsw.options import add_file
from fsw_quality.signature import PublicKey, default_key, load_public


def add_private_key(parser: argparse.ArgumentParser) -> None:
    """Add the option for the key that signs."""
    add_file(parser, "--key", f"private key that signs (default: that of '{program()} bag keygen')", default=None)


def add_public_keys(parser: argparse.ArgumentParser) -> None:
    """Add the option for the keys that are trusted."""
    text = f"public key of a trusted signer; may be repeated (default: that of '{program()} bag keygen')"
    parser.add_argument("--key", type=Path, action="append", metavar="FILE.pub", default=[], help=text)


def private_key(arguments: argparse.Namespace) -> Path:
    """Path of the key that signs."""
    chosen: Path = arguments.key or default_key()
    return chosen


def trusted_keys(arguments: argparse.Namespace) -> list[PublicKey]:
    """Keys that are trusted."""
    default = default_key()
    return [load_public(path) for path in arguments.key or [default.with_name(f"{default.name}.pub")]]
