"""Shared by the commands that sign and verify."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.command import Option, file, repeated
from fsw_quality.signature import default_key, load_private


def public_keys(text: str) -> Option:
    """The option for keys of signers that are trusted."""
    return repeated("--key", "FILE.pub", text, type=Path)


PRIVATE_KEY = file("--key", "private key that signs (default: that of 'fsw.py bag keygen')")


def private_key(arguments: argparse.Namespace) -> Any:
    """The key that signs."""
    chosen: Path = arguments.key or default_key()
    return load_private(chosen)
