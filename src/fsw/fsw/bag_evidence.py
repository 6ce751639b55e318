"""``fsw.py bag keygen``, ``attest``, ``verify-evidence``: whether bags are what was recorded and signed."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path

from fsw.bags import bag_argument, print_notes
from fsw.command import FORCE, command, file, option, repeated
from fsw.errors import CommandError
from fsw.keys import PRIVATE_KEY, private_key, public_keys
from fsw.outputs import check_new, write_json
from fsw_quality.attestation import Attestation, Chain, attest, read_chain, verify_bag
from fsw_quality.procedure import load, shipped
from fsw_quality.signature import default_key, load_public, make_key
from fsw_recorder import after_recording


@command(
    "bag keygen",
    "make the pair of keys that signs attestations and procedures",
    option(  # the same for all users, for the documentation
        "file", type=Path, nargs="?", help=f"private key (default: ~/.config/fsw-control/{default_key().name})"
    ),
    description="Make an Ed25519 key pair in the format of OpenSSH: FILE, for its owner alone and without a "
    "passphrase, and FILE.pub, for everyone who verifies.",
)
def keygen(arguments: argparse.Namespace) -> int:
    path = arguments.file or default_key()
    public = make_key(path)
    print(f"private key: {path} (keep it from others and out of repositories)")
    print(f"public key:  {path}.pub, {public.fingerprint}")
    return 0


@command(
    "bag attest",
    "sign for bags and add them to the chain of welds",
    bag_argument("folder of a bag; several in the order in which they were welded", "+"),
    file("--chain", "folder of the chain; made when there is none", "DIR", required=True),
    option("--procedure", help=f"procedure of the weld: YAML file, or one of {', '.join(shipped())}"),
    repeated("--with", "FILE", "also sign for this file, e.g. the record of the weld", type=Path, dest="documents"),
    PRIVATE_KEY,
    description="Check the files of bags against their manifests, sign them together with the procedure and the "
    "software, and add them to the chain of welds. A bag that is not what was recorded is not attested.",
)
def attested(arguments: argparse.Namespace) -> int:
    key = private_key(arguments)
    procedure = load(arguments.procedure).identity if arguments.procedure else None
    for bag in arguments.bag:
        after_recording.wait(bag, lambda text: print_notes([text]))
        made = attest(bag, arguments.chain, key, datetime.now(UTC), procedure, arguments.documents)
        print_notes(made.notes)
        print(f"{bag}: attested as weld {made.number} of {arguments.chain}, {len(made.files_sha256)} files")
    return 0


@command(
    "bag verify-evidence",
    "whether bags are what was recorded and signed, to the chunk",
    bag_argument("folder of an attested bag; none: only the chain", "*"),
    file("--chain", "folder of the chain of welds; left out: it is not checked", "DIR"),
    repeated("--with", "FILE", "check this file, too, which was attested with the bag", type=Path, dest="documents"),
    public_keys("public key of a trusted signer (default: that of 'fsw.py bag keygen')"),
    file("--json", "also write what was found"),
    FORCE,
    description="Check signatures, manifests and files of bags, and the chain of welds. Exit code 0: all is proven; "
    "1: not.",
)
def verified(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    if not arguments.bag and arguments.chain is None:
        raise CommandError("verify-evidence: give bags, or --chain, or both")
    if arguments.documents and len(arguments.bag) != 1:
        raise CommandError("verify-evidence: --with needs exactly one bag")
    default = default_key()
    trusted = [load_public(path) for path in arguments.key or [default.with_name(f"{default.name}.pub")]]
    chain = read_chain(arguments.chain, trusted) if arguments.chain else None
    problems = list(chain.problems) if chain else []
    if chain is not None and not chain.entries and not problems:
        problems.append(f"{chain.folder}: there is no attested weld in it")
    if chain is not None:
        _print_chain(chain)
    results = []
    for bag in arguments.bag:
        attested, found = verify_bag(bag, trusted, chain, arguments.documents)
        lines = [f"{bag}: {one.line}" for one in found]
        problems += lines
        results.append({"bag": str(bag), "findings": [one._asdict() for one in found]})
        if not lines and attested is not None:
            with_it = [f"{path.name} as attested" for path in arguments.documents]
            print(f"{bag}: proven: {'; '.join([_words(attested, chain), *with_it])}")
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
