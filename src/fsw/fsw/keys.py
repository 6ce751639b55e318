"""Common options of the commands that sign and verify."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from fsw.command import file, repeated, switch
from fsw_recorder.signature import TrustedKey, default_key, load_private, load_trusted, public_path

if TYPE_CHECKING:  # from the extra signing
    from securesystemslib.signer import CryptoSigner

PRIVATE_KEY = file("--key", "private key that signs (default: ~/.config/fsw-control/evidence_key)")
TRUSTED = repeated(
    "--trusted",
    "FILE",
    "public key of a trusted signer, or a list of them with purposes and validity (YAML)",
    type=Path,
)
REQUIRE_SIGNED = switch("--require-signed", "refuse a procedure and a manifest that nobody signed")
REQUIRE_SIGNED_PROCEDURE = switch("--require-signed", "refuse a procedure that nobody signed")


def private_key(arguments: argparse.Namespace) -> CryptoSigner:
    """The signing key."""
    return load_private(arguments.key or default_key())


def trusted_keys(arguments: argparse.Namespace, own: bool = False) -> tuple[TrustedKey, ...]:
    """The trusted keys, with that of the signing key if the user's ``own`` counts.

    An entry of a list prevails over it.
    """
    key = getattr(arguments, "key", None) or default_key()
    return load_trusted([*([public_path(key)] if own else []), *arguments.trusted])
