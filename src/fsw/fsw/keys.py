"""Common options of the commands that sign and verify."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from fsw.command import file, repeated, switch
from fsw_recorder.signature import SigningKey, TrustedKey, default_key, load_private, load_trusted

PRIVATE_KEY = file("--key", "private key that signs (default: that of 'fsw.py bag keygen')")
TRUSTED = repeated(
    "--trusted",
    "FILE",
    "public key of a trusted signer, or a list of them with purposes and validity (YAML)",
    type=Path,
)
REQUIRE_SIGNED = switch("--require-signed", "refuse a procedure and a manifest that nobody signed")
REQUIRE_SIGNED_PROCEDURE = switch("--require-signed", "refuse a procedure that nobody signed")


def private_key(arguments: argparse.Namespace) -> SigningKey:
    """The signing key."""
    return load_private(arguments.key or default_key())


def trusted_keys(
    arguments: argparse.Namespace, default: Sequence[Path] = ()
) -> tuple[TrustedKey, ...]:
    """The trusted keys."""
    return load_trusted(arguments.trusted or default)
