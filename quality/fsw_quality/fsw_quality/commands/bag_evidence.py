"""``fsw.py bag attest`` and ``verify-evidence``: whether bags are what was recorded and signed."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from fsw.bags import bag_argument, print_notes
from fsw.command import FORCE, command, file, option, repeated, switch
from fsw.console import ProgressBar
from fsw.errors import CommandError
from fsw.keys import PRIVATE_KEY, REQUIRE_SIGNED, TRUSTED, private_key, trusted_keys
from fsw.outputs import check_new, write_json
from fsw_quality.attestation import Chain, read_chain
from fsw_quality.evidence import Policy, Subject, Verification, attest, verify_bag
from fsw_recorder import after_recording
from fsw_recorder.findings import Code, Finding, Unchecked, finding
from fsw_scenario.procedure import load, shipped, signer_of


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
    switch("--afterwards", "also a bag whose recorder did not hash all of it; this is noted"),
    switch("--repeat", "also a second weld of a canister and lid; this is noted"),
    description="Check that bag, manifest, procedure and documents are of one weld, judge the weld again where its "
    "record is among them, sign for all, and add it to the chain of welds. What does not fit is not attested.",
)
def attested(arguments: argparse.Namespace) -> int:
    key, trusted = private_key(arguments), trusted_keys(arguments, own=True)
    policy = Policy(trusted, arguments.require_signed, arguments.afterwards, arguments.repeat)
    source = arguments.procedure
    procedure = load(source) if source else None
    signer = signer_of(source, trusted, arguments.require_signed) if source else None
    for bag in arguments.bag:
        after_recording.wait(bag, lambda text: print_notes([text]))
        subject = Subject(bag, procedure, signer, arguments.documents)
        with ProgressBar(f"judging {bag}") as bar:
            made = attest(subject, arguments.chain, key, datetime.now(UTC), policy, bar)
        print_notes(entry.line for entry in made.notes)
        print(f"{bag}: attested as weld {made.number} of {arguments.chain}")
    return 0


@command(
    "bag verify-evidence",
    "whether bags are what was recorded and signed, to the chunk",
    bag_argument("folder of an attested bag; none: only the chain", "*"),
    file("--chain", "folder of the chain of welds; left out: it is not checked", "DIR"),
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
    policy = Policy(trusted_keys(arguments, own=not arguments.trusted), arguments.require_signed)
    chain = read_chain(arguments.chain, policy.trusted) if arguments.chain else None
    broken = _print_chain(chain) if chain else []
    now = datetime.now(UTC)
    results = [verify_bag(bag, policy, now, chain) for bag in arguments.bag]
    for result in results:
        _print(result)
    content = {
        "chain": [entry.model_dump(mode="json") for entry in broken] if chain else None,
        "bags": [result.model_dump(mode="json") for result in results],
    }
    write_json(arguments.json, content)
    return 1 if broken or any(result.findings for result in results) else 0


def _print_chain(chain: Chain) -> Sequence[Finding]:
    """Print the state of a chain; returns what is wrong."""
    number, folder = len(chain.entries), chain.folder
    wrong = chain.findings or (() if number else (finding(Code.EMPTY, folder),))
    print(f"{folder}: {'not ' if wrong else ''}intact, {number} weld{'s' * (number != 1)}")
    _print_lines("", wrong)
    end = finding(Unchecked.CHAIN_END, folder, number=number, sha256=chain.last_sha256)
    _print_lines("not checked: ", [end] if number else [])
    return wrong


def _print(result: Verification) -> None:
    made, parts = result.attested, list[str]()
    if made is not None:
        parts = [f"weld {made.number}", *(f"{key} {made.identity[key]}" for key in made.identity)]
        absent = sum(one.code is Unchecked.DOCUMENT_ABSENT for one in result.not_checked)
        of = len(made.documents)
        parts += [f"{of - absent} of {of} documents"] if of else []
        by = made.procedure
        parts += [f"procedure {by.id} revision {by.revision}"] if by else []
    state = "not proven" if result.findings else "proven"
    print(f"{result.bag}: {': '.join(filter(None, [state, ', '.join(parts)]))}")
    _print_lines("", result.findings)
    for purpose, signer in result.signers.items():
        print(f"  {purpose} signed by {signer.words}")
    _print_lines("not checked: ", result.not_checked)


def _print_lines(head: str, findings: Sequence[Finding]) -> None:
    for entry in findings:
        print(f"  {head}{entry.line}")
