"""``fsw.py bag attest`` and ``verify-evidence``: whether bags are what was recorded and signed."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime

from pydantic_core import to_jsonable_python

from fsw.bags import bag_argument, print_notes
from fsw.command import (
    FORCE,
    PRIVATE_KEY,
    REQUIRE_SIGNED,
    TRUSTED,
    command,
    file,
    option,
    private_key,
    trusted_keys,
)
from fsw.console import ProgressBar, check_new, write_json
from fsw.errors import CommandError
from fsw_quality.attestation import Chain
from fsw_quality.evidence import Policy, Subject, Verification, attest, verify_bag
from fsw_recorder import after_recording
from fsw_recorder.findings import Code, Finding, Unchecked, finding
from fsw_scenario.procedure import load, shipped, signer_of

_SHIPPED = ", ".join(shipped())


@command(
    "bag attest",
    "sign for bags and add them to the chain of welds",
    bag_argument("folder of a bag; several in the order in which they were welded", "+"),
    file("--chain", "folder of the chain; made when there is none", "DIR", required=True),
    option("--procedure", help=f"YAML file, or one of {_SHIPPED} (default: that in the bag)"),
    file("--record", "folder of the record (default: record in that of the bag, if any)", "DIR"),
    PRIVATE_KEY,
    TRUSTED,
    REQUIRE_SIGNED,
    description="Check that bag, manifest, procedure and record (if any) are of one weld, "
    "judge it again, sign for all, and add it to the chain. What does not fit is not attested.",
)
def attested(arguments: argparse.Namespace) -> int:
    key, trusted = private_key(arguments), trusted_keys(arguments, own=True)
    policy = Policy(trusted, arguments.require_signed)
    procedure = signer = None
    if source := arguments.procedure:
        procedure, signer = load(source), signer_of(source, trusted, arguments.require_signed)
    for bag in arguments.bag:
        after_recording.wait(bag, lambda text: print_notes([text]))
        subject = Subject(bag, procedure, signer, arguments.record)
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
    description="Check signatures, manifests, files and documents of bags, the chain of welds; "
    "print signers and what was not checked. Exit code 0: all that was checked is proven.",
)
def verified(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    if not arguments.bag and arguments.chain is None:
        raise CommandError("verify-evidence: give bags, or --chain, or both")
    policy = Policy(trusted_keys(arguments, own=not arguments.trusted), arguments.require_signed)
    chain = Chain(arguments.chain, policy.trusted) if arguments.chain else None
    broken = _print_chain(chain) if chain else []
    results = [verify_bag(bag, policy, datetime.now(UTC), chain) for bag in arguments.bag]
    for result in results:
        signed = [f"{use} signed by {by.words}" for use, by in result.signers.items()]
        _print(_title(result), result.findings, result.not_checked, *signed)
    content = {"chain": broken if chain else None, "bags": results}
    write_json(arguments.json, to_jsonable_python(content))
    return 1 if broken or any(result.findings for result in results) else 0


def _print_chain(chain: Chain) -> Sequence[Finding]:
    """Print the state of a chain; returns what is wrong."""
    number, folder = len(chain.entries), chain.folder
    wrong = chain.findings or ([] if number else [finding(Code.EMPTY, folder)])
    end = finding(Unchecked.CHAIN_END, folder, number=number, sha256=chain.last_sha256)
    title = f"{folder}: {'not ' * bool(wrong)}intact, {number} weld{'s' * (number != 1)}"
    _print(title, wrong, [end] * bool(number))
    return wrong


def _title(result: Verification) -> str:
    """Whether a bag is proven, and what was attested."""
    state, parts = "not proven" if result.findings else "proven", list[str]()
    if made := result.attested:
        absent = sum(entry.code is Unchecked.DOCUMENT_ABSENT for entry in result.not_checked)
        of, by = len(made.documents), made.procedure
        parts = [f"weld {made.number}", *(f"{key} {name}" for key, name in made.identity.items())]
        parts += [f"{of - absent} of {of} documents"] if of else []
        parts += [f"procedure {by.id} revision {by.revision}"] if by else []
    return f"{result.bag}: {state}{': ' * bool(parts)}{', '.join(parts)}"


def _print(title: str, wrong: Sequence[Finding], rest: Sequence[Finding], *signed: str) -> None:
    not_checked = [f"not checked: {entry.line}" for entry in rest]
    print(title, *(entry.line for entry in wrong), *signed, *not_checked, sep="\n  ")
