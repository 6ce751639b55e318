"""``fsw.py bag verify-evidence``: are bags what was recorded and signed?"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.bags import add_bag_command
from fsw.errors import CommandError
from fsw.keys import add_public_keys, trusted_keys
from fsw.options import add_file, add_force, add_repeated
from fsw.outputs import check_new, write_json
from fsw_quality.attestation import Attestation, Chain, read_chain, verify_bag


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    parser = add_bag_command(
        commands,
        "verify-evidence",
        _run,
        "whether bags are what was recorded and signed, to the chunk",
        "folder of an attested bag; none: only the chain",
        "Check signatures, manifests and files of bags, and the chain of welds. Exit code 0: all is proven; 1: not.",
        optional=True,
    )
    add_file(parser, "--chain", "folder of the chain of welds; left out: it is not checked", "DIR")
    add_repeated(parser, "--with", "FILE", "check this file, too, which was attested with the bag", dest="documents")
    add_public_keys(parser)
    add_file(parser, "--json", "also write what was found")
    add_force(parser)


def _run(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    if not arguments.bag and arguments.chain is None:
        raise CommandError("verify-evidence: give bags, or --chain, or both")
    if arguments.documents and len(arguments.bag) != 1:
        raise CommandError("verify-evidence: --with needs exactly one bag")
    trusted = trusted_keys(arguments)
    chain = read_chain(arguments.chain, trusted) if arguments.chain else None
    problems = list(chain.problems) if chain else []
    if chain is not None and not chain.entries:
        problems.append(f"{chain.folder}: there is no attested weld in it")
    if chain is not None:
        _print_chain(chain)
    results = []
    for bag in arguments.bag:
        attested, found = verify_bag(bag, trusted, chain, [Path(one) for one in arguments.documents])
        lines = [f"{bag}: {one.line}" for one in found]
        problems += lines
        results.append({"bag": str(bag), "findings": [one._asdict() for one in found]})
        if not lines and attested is not None:
            print(f"{bag}: proven: {_words(attested, chain)}")
    for problem in problems:
        print(problem)
    write_json(arguments.json, {"chain": list(chain.problems) if chain else None, "bags": results})
    return 1 if problems else 0


def _print_chain(chain: Chain) -> None:
    if chain.entries:
        last = chain.entries[-1]
        state = "intact" if not chain.problems else "not intact"
        print(f"{chain.folder}: {state}, {len(chain.entries)} welds, the last is {last.content.number}: {last.sha256}")


def _words(attested: Attestation, chain: Chain | None) -> str:
    parts = [f"{len(attested.files_sha256)} files as recorded, attested {attested.attested_at}"]
    parts.append(f"weld {attested.number}" + ("" if chain else " (chain not checked)"))
    if attested.procedure is not None:
        parts.append(f"procedure {attested.procedure.id} revision {attested.procedure.revision}")
    parts += [f"{key} {value}" for key, value in attested.identity.items()]
    parts += [f"noted: {note}" for note in attested.notes]
    return "; ".join(parts)
