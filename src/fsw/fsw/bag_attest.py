"""``fsw.py bag attest``: sign for recorded welds."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fsw.bags import add_bag_command, print_notes
from fsw.keys import add_private_key, private_key
from fsw.options import add_file, add_repeated
from fsw_quality.attestation import attest
from fsw_quality.procedure import load, shipped
from fsw_quality.signature import load_private


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    parser = add_bag_command(
        commands,
        "attest",
        _run,
        "sign for bags and add them to the chain of welds",
        "folder of a bag; several in the order in which they were welded",
        "Check the files of bags against their manifests, sign them together with the procedure and the software, and "
        "add them to the chain of welds. A bag that is not what was recorded is not attested.",
        several=True,
    )
    add_file(parser, "--chain", "folder of the chain; made when there is none", "DIR", required=True)
    parser.add_argument("--procedure", help=f"procedure of the weld: YAML file, or one of {', '.join(shipped())}")
    add_repeated(parser, "--with", "FILE", "also sign for this file, e.g. the record of the weld", dest="documents")
    add_private_key(parser)


def _run(arguments: argparse.Namespace) -> int:
    key = load_private(private_key(arguments))
    procedure = load(arguments.procedure).identity if arguments.procedure else None
    documents = [Path(one) for one in arguments.documents]
    for bag in arguments.bag:
        made = attest(bag, arguments.chain, key, datetime.now(UTC), procedure, documents)
        print_notes(made.notes)
        print(f"{bag}: attested as weld {made.number} of {arguments.chain}, {len(made.files_sha256)} files")
    return 0
