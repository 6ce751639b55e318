"""``fsw.py bag keygen``, ``attest``, ``verify-evidence``: whether bags are what was recorded and signed."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path

from fsw.bags import bag_argument, print_notes
from fsw.command import FORCE, command, file, option, repeated, switch
from fsw.console import ProgressBar
from fsw.errors import CommandError
from fsw.keys import PRIVATE_KEY, REQUIRE_SIGNED, TRUSTED, private_key, trusted_keys
from fsw.outputs import check_new, write_json
from fsw_quality.attestation import Chain, identity_words, read_chain
from fsw_quality.evidence import Policy, Subject, Verification, attest, verify_bag
from fsw_recorder import after_recording
from fsw_recorder.findings import Code, Finding, finding
from fsw_recorder.signature import default_key, make_key, public_path
from fsw_scenario.procedure import load, shipped, signer_of

_MOST_FINDINGS = 10


@command(
    "bag keygen",
    "make the pair of keys that signs manifests, attestations and procedures",
    option(  # the same for all users, for the documentation
        "file",
        type=Path,
        nargs="?",
        help=f"private key (default: ~/.config/fsw-control/{default_key().name})",
    ),
    description="Make an Ed25519 key pair in the format of OpenSSH: FILE, for its owner alone and without a "
    "passphrase, and FILE.pub, for everyone who verifies.",
)
def keygen(arguments: argparse.Namespace) -> int:
    path = arguments.file or default_key()
    fingerprint = make_key(path)
    print(f"private key: {path} (keep it from others and out of repositories)")
    print(f"public key:  {public_path(path)}, {fingerprint}")
    return 0


@command(
    "bag attest",
    "sign for bags and add them to the chain of welds",
    bag_argument("folder of a bag; several in the order in which they were welded", "+"),
    file("--chain", "folder of the chain; made when there is none", "DIR", required=True),
    option(
        "--procedure",
        help=f"procedure of the weld: YAML file, or one of {', '.join(shipped())} (default: that in the bag)",
    ),
    repeated(
        "--with",
        "FILE",
        "also sign for this file, e.g. the record of the weld",
        type=Path,
        dest="documents",
    ),
    PRIVATE_KEY,
    TRUSTED,
    REQUIRE_SIGNED,
    switch(
        "--afterwards",
        "also attest a bag whose recorder did not hash all of it; the attestation notes it",
    ),
    switch(
        "--repeat", "also attest a second weld of a canister and lid; the attestation notes it"
    ),
    description="Check that bag, manifest, procedure and documents are of one weld, judge the weld again where its "
    "record is among them, sign for all, and add it to the chain of welds. What does not fit is not attested.",
)
def attested(arguments: argparse.Namespace) -> int:
    key, trusted = private_key(arguments), trusted_keys(arguments)
    policy = Policy(trusted, arguments.require_signed, arguments.afterwards, arguments.repeat)
    source = arguments.procedure
    procedure = load(source) if source else None
    signer = signer_of(source, trusted or None, arguments.require_signed) if source else None
    for bag in arguments.bag:
        after_recording.wait(bag, lambda text: print_notes([text]))
        subject = Subject(bag, procedure, signer, arguments.documents)
        with ProgressBar(f"judging {bag}") as bar:
            made = attest(subject, arguments.chain, key, datetime.now(UTC), policy, bar)
        print_notes(entry.line for entry in made.notes)
        print(
            f"{bag}: attested as weld {made.number} of {arguments.chain}, {len(made.files_sha256)} files"
        )
    return 0


@command(
    "bag verify-evidence",
    "whether bags are what was recorded and signed, to the chunk",
    bag_argument("folder of an attested bag; none: only the chain", "*"),
    file("--chain", "folder of the chain of welds; left out: it is not checked", "DIR"),
    repeated(
        "--with",
        "FILE",
        "an attested file that is not in the bag's folder",
        type=Path,
        dest="documents",
    ),
    TRUSTED,
    REQUIRE_SIGNED,
    file("--json", "also write what was found"),
    FORCE,
    description="Check signatures, manifests, files and attested documents of bags, and the chain of welds. Prints who "
    "signed, and what was not checked. Exit code 0: all that was checked is proven; 1: not.",
)
def verified(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    if not arguments.bag and arguments.chain is None:
        raise CommandError("verify-evidence: give bags, or --chain, or both")
    if arguments.documents and len(arguments.bag) != 1:
        raise CommandError("verify-evidence: --with needs exactly one bag")
    policy = Policy(
        trusted_keys(arguments, [public_path(default_key())]), arguments.require_signed
    )
    chain = read_chain(arguments.chain, policy.trusted) if arguments.chain else None
    broken = _print_chain(chain) if chain else []
    now = datetime.now(UTC)
    results = [verify_bag(bag, policy, now, chain, arguments.documents) for bag in arguments.bag]
    for result in results:
        _print_bag(result)
    content = {
        "chain": [entry.as_json() for entry in broken] if chain else None,
        "bags": [_as_json(result) for result in results],
    }
    write_json(arguments.json, content)
    return 1 if broken or any(result.findings for result in results) else 0


def _print_chain(chain: Chain) -> list[Finding]:
    """Print the state of a chain; returns what is wrong."""
    findings = [*chain.findings]
    if chain.entries:
        last = chain.entries[-1]
        state = "not intact" if findings else "intact"
        print(f"{chain.folder}: {state}, {len(chain.entries)} welds")
        end = finding(Code.CHAIN_END, chain.folder, number=last.content.number, sha256=last.sha256)
        print(f"not checked: {end.line}")
    elif not findings:
        findings = [finding(Code.EMPTY, chain.folder)]
    for entry in findings[:_MOST_FINDINGS]:
        print(f"{chain.folder}: {entry.line}")
    if (more := len(findings) - _MOST_FINDINGS) > 0:
        print(f"{chain.folder}: and {more} more")
    return findings


def _print_bag(result: Verification) -> None:
    attested = result.attested
    for entry in result.findings:
        print(f"{result.bag}: {entry.line}")
    if attested is not None:
        state = "not proven" if result.findings else "proven"
        parts = [f"weld {attested.number}", f"{len(attested.files_sha256)} files"]
        parts += (
            [f"{len(attested.documents_sha256)} documents"] if attested.documents_sha256 else []
        )
        if attested.procedure is not None:
            parts.append(
                f"procedure {attested.procedure.id} revision {attested.procedure.revision}"
            )
        parts += [identity_words(attested.identity)] if attested.identity else []
        print(f"{result.bag}: {state}: {'; '.join(parts)}")
    for purpose, signer in result.signers.items():
        print(f"  {purpose} signed by {signer.words}")
    for entry in attested.notes if attested else ():
        print(f"  noted: {entry.line}")
    for entry in result.not_checked:
        print(f"  not checked: {entry.line}")


def _as_json(result: Verification) -> dict[str, object]:
    return {
        "bag": str(result.bag),
        "proven": result.attested is not None and not result.findings,
        "attestation": result.attested.model_dump(mode="json") if result.attested else None,
        "signed_by": {
            str(key): signer.model_dump(mode="json") for key, signer in result.signers.items()
        },
        "findings": [entry.as_json() for entry in result.findings],
        "not_checked": [entry.as_json() for entry in result.not_checked],
    }
