"""Signed statements about recorded welds, each with the hash of the one before it: a chain over welds.

``attestation.json`` in the folder of a bag is an in-toto statement in a DSSE envelope: its subject
are the hashes of manifest, files and documents, its predicate an `Attestation`. The folder of the
chain has a copy of each by its number, so that a weld that is removed later leaves a hole.
``evidence.py`` makes and verifies them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import AwareDatetime, Strict

from fsw_control.schema.models import InputError, Many, Model, validate
from fsw_recorder.bag_metadata import IDENTITY
from fsw_recorder.bag_reader import SUFFIXES
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, Finding, finding
from fsw_recorder.manifest import Manifest, sha256
from fsw_recorder.signature import Purpose, Signer, TrustedKey, open_envelope, read_file
from fsw_scenario.procedure import Identity

T = TypeVar("T")
#: clocks of two computers may differ by so much (chosen)
CLOCKS = timedelta(seconds=60)


class Attestation(Model):
    """What is stated about a bag, its manifest and documents: the predicate of attestation.json."""

    number: int
    """place in the chain, from 1"""
    previous_sha256: str | None = None
    """of the attestation before it; the first has none"""
    repeats: bool = False
    """the signer allows that canister and lid were welded before"""
    bag: str
    """name of the folder, of one called ``bag`` with that of its parent"""
    identity: dict[str, str]
    """canister, lid, tool and machine, as they were given to the recorder"""
    procedure: Identity | None = None
    procedure_signer: Signer | None = None
    documents: Many[str]
    """names of the files that were attested together with the bag, e.g. the record of the weld"""
    notes: Many[Finding]
    """what was not as it should be when it was attested, or was not checked"""
    signed_at: Annotated[AwareDatetime, Strict(False)]
    """by the clock of the computer that signed"""

    @property
    def welded(self) -> str:
        """Canister and lid, which are welded once, e.g. ``canister C-1, lid L-7``; empty where they are unknown."""
        known = [key for key in IDENTITY[:2] if key in self.identity]
        return ", ".join(f"{key} {self.identity[key]}" for key in known if "canister" in known)


@dataclass(frozen=True, slots=True)
class Signed:
    """An attestation as it was found; ``before`` is the hash of the file before it in its chain."""

    path: Path
    data: bytes
    sha256: Mapping[str, str]
    """of the files that it is about"""
    content: Attestation
    signer: Signer
    before: str | None = None

    @property
    def data_sha256(self) -> set[str]:
        """Hashes of the files with the messages."""
        return {digest for name, digest in self.sha256.items() if name.endswith(SUFFIXES)}


def opened(
    path: Path, data: bytes, trusted: Sequence[TrustedKey], before: str | None = None
) -> Signed:
    """The attestation in a file, verified; EvidenceError as of `open_envelope`, InputError if it is none."""
    signed = open_envelope(data, Purpose.ATTESTATION, trusted, path.name)
    content = validate(Attestation, signed.predicate, path.name)
    return Signed(path, data, signed.sha256, content, signed.signer, before)


def tried(findings: list[Finding], file: object, check: Callable[[], T]) -> T | None:
    """Result of a check; None where it fails, which is among the findings then."""
    try:
        return check()
    except (BagError, InputError, OSError) as error:  # that of an EvidenceError has findings
        findings += getattr(error, "findings", [finding(Code.UNREADABLE, file, reason=error)])
        return None


@dataclass(frozen=True, slots=True)
class Chain:
    """The attestations of a folder, in order, what is wrong with them, and the hash of the last."""

    folder: Path
    entries: tuple[Signed, ...]
    findings: tuple[Finding, ...]
    last_sha256: str | None


def read_chain(folder: Path, trusted: Sequence[TrustedKey]) -> Chain:
    """All attestations of a chain: their signatures, their order, whether one is missing or was exchanged.

    A chain that was cut off at its end is intact in itself: compare its last number and hash with
    what was noted.
    """
    entries: list[Signed] = []
    findings: list[Finding] = []
    before: str | None = None
    for path in sorted(path for path in folder.glob("*.json") if path.stem.isdecimal()):
        if (data := tried(findings, path.name, partial(read_file, path))) is not None:
            entry = tried(findings, path.name, partial(opened, path, data, trusted, before))
            entries += [entry] if entry else []
            before = sha256(data)
    return Chain(folder, tuple(entries), (*findings, *chain_findings(entries)), before)


def chain_findings(entries: Sequence[Signed]) -> Iterator[Finding]:
    """What is wrong with the order of attestations, and which bags and canisters are there twice.

    Each states the hash of the file before it: a hole, an exchange and another order all break
    that link, whatever the files are called, and only at the place where it happened.
    """
    bags: dict[str, Attestation] = {}
    canisters: dict[str, Attestation] = {}
    for entry, previous in zip(entries, [None, *entries], strict=False):
        file, content = entry.path.name, entry.content
        if content.previous_sha256 != entry.before:
            yield finding(Code.BROKEN_LINK, file, number=content.number)
        times = (
            {f"attestation of {previous.path.name}": previous.signer.signed_at} if previous else {}
        )
        yield from order_findings(file, {**times, "attested": entry.signer.signed_at})
        earlier = next((bags[key] for key in entry.data_sha256 if key in bags), None)
        if earlier is not None:
            yield finding(Code.ATTESTED_TWICE, file, number=earlier.number, bag=earlier.bag)
        elif content.welded in canisters and not content.repeats:
            number = canisters[content.welded].number
            yield finding(Code.CANISTER_TWICE, file, identity=content.welded, number=number)
        bags |= dict.fromkeys(entry.data_sha256, content)
        canisters |= {content.welded: content} if content.welded else {}


def order_findings(file: str, times: Mapping[str, datetime | None]) -> list[Finding]:
    """What of these events, in their order, is earlier than the one before it; the unknown times are left out."""
    known = [(name, time) for name, time in times.items() if time is not None]
    return [
        finding(Code.TIME_ORDER, file, later=later, later_at=at, earlier=earlier, earlier_at=since)
        for (earlier, since), (later, at) in pairwise(known)
        if at < since - CLOCKS
    ]


def weld_times(manifest: Manifest) -> tuple[datetime | None, datetime | None]:
    """When the first and the last chunk begin, by the computer's clock; None for a simulated clock."""
    pieces = [piece for file in manifest.files for piece in file.pieces]
    stamps_s = [piece.begin_ns * 1e-9 for piece in pieces if piece.begin_ns is not None]
    if not stamps_s or min(stamps_s) < 1e9:  # the year 2001: a simulation counts from 0
        return None, None
    begin, end = (datetime.fromtimestamp(at, UTC) for at in (min(stamps_s), max(stamps_s)))
    return begin, end
