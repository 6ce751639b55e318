"""Signed statements about recorded welds, each with the hash of the one before it.

A chain over welds.

``attestation.json`` in the folder of a bag is an in-toto statement in a DSSE envelope: its subject
are the hashes of manifest, files and documents, its predicate an `Attestation`. The folder of the
chain has a copy of each by its number, so that a weld that is removed later leaves a hole.
``evidence.py`` makes and verifies them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from fsw_analysis.procedure import Identity
from fsw_control.schema.models import InputError, Many
from fsw_recorder import signature
from fsw_recorder.bag_metadata import IDENTITY
from fsw_recorder.bag_reader import SUFFIXES
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, Finding, finding
from fsw_recorder.manifest import Manifest, sha256

T = TypeVar("T")
#: clocks of two computers may differ by so much (chosen)
CLOCKS = timedelta(seconds=60)


class Attestation(signature.Stated):
    """What is stated about a bag, its manifest and documents.

    The predicate of attestation.json.
    """

    number: int
    """place in the chain, from 1"""
    previous_sha256: str | None = None
    """of the attestation before it; the first has none"""
    bag: str
    """name of the folder, of one called ``bag`` with that of its parent"""
    identity: dict[str, str]
    """canister, lid, tool and machine, as they were given to the recorder"""
    procedure: Identity | None = None
    procedure_signer: signature.Signer | None = None
    documents: Many[str]
    """record.json, page and PDF that were attested together with the bag: their paths from it"""
    notes: Many[Finding]
    """what was not as it should be when it was attested, or was not checked"""

    @property
    def welded(self) -> str:
        """Canister and lid, which are welded once, e.g. ``canister C-1, lid L-7``.

        Empty where they are unknown.
        """
        known = [key for key in IDENTITY[:2] if key in self.identity]
        return ", ".join(f"{key} {self.identity[key]}" for key in known if "canister" in known)


def tried(
    findings: list[Finding], file: object, check: Callable[..., T], *arguments: Any
) -> T | None:
    """Result of a check; None where it fails, which is among the findings then."""
    try:
        return check(*arguments)
    except (BagError, InputError, OSError) as error:  # that of an EvidenceError has findings
        findings += getattr(error, "findings", [finding(Code.UNREADABLE, file, reason=error)])
        return None


class Chain:
    """The attestations of a folder, in order, what is wrong with them, and the hash of the last.

    Each states its number and the hash of the file before it: a hole, an exchange and another
    order all break that link, and only at the place where it happened. A chain that was cut off at
    its end is intact in itself: compare its last number and hash with what was noted.
    """

    def __init__(self, folder: Path, trusted: Sequence[signature.TrustedKey]) -> None:
        self.folder, self.trusted = folder, trusted
        self.entries: list[signature.Statement[Attestation]] = []
        self.findings: list[Finding] = []
        self.last_sha256: str | None = None
        self._seen: dict[str, Attestation] = {}
        for path in sorted(path for path in folder.glob("*.json") if path.stem.isdecimal()):
            tried(self.findings, path.name, self.add, path)

    def add(self, path: Path, new: bytes | None = None) -> None:
        """Check the next file, or the content of a ``new`` one.

        EvidenceError if it is no attestation.
        """
        file, data = path.name, signature.read_file(path) if new is None else new
        before, self.last_sha256 = self.last_sha256, sha256(data)
        kind = signature.Purpose.ATTESTATION, Attestation, self.trusted, file
        entry = signature.open_envelope(data, *kind)
        stated, last = entry.predicate, self.entries[-1].signer.signed_at if self.entries else None
        times = {"attestation before it": last, "attested": entry.signer.signed_at}
        if (stated.previous_sha256, f"{stated.number:06d}.json") != (before, file):
            self.findings.append(finding(Code.BROKEN_LINK, file, number=stated.number))
        self.findings += order_findings(file, times)
        hashes = [entry.sha256[name] for name in entry.sha256 if name.endswith(SUFFIXES)]
        welded = [stated.welded] if stated.welded else []
        for code, keys in ((Code.ATTESTED_TWICE, hashes), (Code.CANISTER_TWICE, welded)):
            if known := [self._seen[key] for key in keys if key in self._seen]:
                twice = {"identity": stated.welded, "number": known[0].number, "bag": known[0].bag}
                self.findings.append(finding(code, file, **twice))
                break  # a bag that is there twice has its canister twice, too
        self._seen |= dict.fromkeys([*hashes, *welded], stated)
        self.entries.append(entry)


def order_findings(file: str, times: Mapping[str, datetime | None]) -> list[Finding]:
    """What of these events, in their order, is earlier than the one before it.

    The unknown times are left out.
    """
    known = [(name, time) for name, time in times.items() if time is not None]
    return [
        finding(Code.TIME_ORDER, file, later=later, later_at=at, earlier=earlier, earlier_at=since)
        for (earlier, since), (later, at) in pairwise(known)
        if at < since - CLOCKS
    ]


def weld_times(manifest: Manifest) -> tuple[datetime | None, datetime | None]:
    """When the first and the last chunk begin, by the computer's clock.

    None for a simulated clock.
    """
    pieces = [piece for file in manifest.files for piece in file.pieces]
    stamps_s = [piece.begin_ns * 1e-9 for piece in pieces if piece.begin_ns is not None]
    if not stamps_s or min(stamps_s) < 1e9:  # the year 2001: a simulation counts from 0
        return None, None
    begin, end = (datetime.fromtimestamp(at, UTC) for at in (min(stamps_s), max(stamps_s)))
    return begin, end
