"""``fsw.py bag keygen``: the keys that sign evidence."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw_quality.signature import default_key, make_key


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    parser = commands.add_parser(
        "keygen",
        help="make the pair of keys that signs attestations and procedures",
        description="Make an Ed25519 key pair in the format of OpenSSH: FILE, for its owner alone and without a "
        "passphrase, and FILE.pub, for everyone who verifies.",
    )
    parser.add_argument("file", type=Path, nargs="?", help=f"private key (default: {_tilde(default_key())})")
    parser.set_defaults(run=_run)


def _tilde(path: Path) -> str:
    """The same for all users, for the documentation."""
    return "~/.config/fsw-control/" + path.name


def _run(arguments: argparse.Namespace) -> int:
    path = arguments.file or default_key()
    public = make_key(path)
    print(f"private key: {path} (keep it from others and out of repositories)")
    print(f"public key:  {path}.pub, {public.fingerprint}")
    return 0
