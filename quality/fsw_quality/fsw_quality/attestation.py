"""Signed statements about recorded welds, each with the hash of the one before it: a chain over welds.

``attestation.json`` in the folder of a bag, beside the recorder's ``manifest.json``, says which
manifest, files, procedure and software belong together; ``attestation.json.sig`` is its signature.
The folder of the chain has a copy of each by its number, so that a weld that is removed later
leaves a hole. ``evidence.py`` makes and verifies them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, Strict

from fsw_control.schema.extensions import MissingExtraError
from fsw_control.schema.files import read_regular
from fsw_control.schema.models import InputError, Many, Model, json_content_of, validate
from fsw_recorder.bag_metadata import ATTESTATION_NAME as ATTESTATION_NAME
from fsw_recorder.bag_metadata import IDENTITY as IDENTITY
from fsw_recorder.bag_metadata import METADATA_NAME, read_metadata
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, EvidenceError, Finding, finding, summary
from fsw_recorder.manifest import MANIFEST_NAME, UNKNOWN, Manifest, mapped, read_manifest, sha256
from fsw_recorder.manifest_check import check_files, complete
from fsw_recorder.signature import Purpose, Signer, TrustedKey, signature_path, verify_file
from fsw_scenario.procedure import Identity

#: clocks of two computers may differ by so much (chosen)
CLOCKS = timedelta(seconds=60)


class Attestation(Model):
    """Content of attestation.json."""

    format: Literal["fsw_weld_attestation"] = "fsw_weld_attestation"
    version: Literal[2] = 2
    number: int
    """place in the chain, from 1"""
    previous_sha256: str | None = None
    """of the attestation before it; the first has none"""
    repeats: int | None = None
    """number of the earlier weld of the same canister and lid, where it was welded again on purpose"""
    bag: str
    """name of the folder, of one called ``bag`` with that of its parent"""
    identity: dict[str, str]
    """canister, lid, tool and machine, as they were given to the recorder"""
    manifest_sha256: str
    """of manifest.json"""
    recorder: Signer | None = None
    """who signed the manifest when the bag was closed"""
    files_sha256: dict[str, str]
    """of the files of the bag"""
    attachments_sha256: dict[str, str]
    """of the files inside the bag: scenario, software versions, parameters of every node"""
    procedure: Identity | None = None
    procedure_signer: Signer | None = None
    software: dict[str, str]
    documents_sha256: dict[str, str]
    """of files that were attested together with the bag, e.g. the record of the weld"""
    notes: Many[Finding]
    """what was not as it should be when it was attested"""
    attested_at: Annotated[AwareDatetime, Strict(False)]
    """by the clock of the computer that signed"""

    def text(self) -> str:
        """As it is written and signed."""
        return self.model_dump_json(indent=1, exclude_none=True) + "\n"

    @property
    def welded(self) -> dict[str, str]:
        """Canister and lid, which are welded once; empty where they are unknown."""
        return {
            key: self.identity[key]
            for key in IDENTITY[:2]
            if key in self.identity and "canister" in self.identity
        }


@dataclass(frozen=True, slots=True)
class Signed:
    """An attestation as it was found."""

    path: Path
    data: bytes
    content: Attestation
    signer: Signer

    @property
    def sha256(self) -> str:
        """What the next one of the chain names it by."""
        return sha256(self.data)


def read_signed(path: Path, trusted: Sequence[TrustedKey] | None) -> Signed:
    """An attestation with its signature, checked; without ``trusted`` keys, any will do.

    Raises
    ------
    InputError
        One of the two is missing or damaged, or the signature is not one of a trusted key.
    """
    signer = verify_file(path, Purpose.ATTESTATION, trusted, path.name)
    data = read_regular(path)
    return Signed(
        path,
        data,
        validate(Attestation, json_content_of(data.decode(), path.name), path.name),
        signer,
    )


@dataclass(frozen=True, slots=True)
class Chain:
    """The attestations of a folder, in order, and what is wrong with them."""

    folder: Path
    entries: tuple[Signed, ...] = ()
    findings: tuple[Finding, ...] = ()

    def of(self, files_sha256: Mapping[str, str]) -> Signed | None:
        """The entry that has one of these MCAP or sqlite3 files."""
        data = data_files(files_sha256)
        return next(
            (entry for entry in self.entries if data & data_files(entry.content.files_sha256)),
            None,
        )


def read_chain(folder: Path, trusted: Sequence[TrustedKey]) -> Chain:
    """All attestations of a chain: their signatures, their order, whether one is missing or was exchanged.

    A chain that was cut off at its end is intact in itself: compare its last number and hash with
    what was noted.
    """
    names = (
        sorted(path for path in folder.glob("*.json") if path.stem.isdecimal())
        if folder.is_dir()
        else []
    )
    entries: list[Signed] = []
    findings: list[Finding] = []
    before: Signed | None = None
    for expected, path in zip([1, *(int(path.stem) + 1 for path in names)], names, strict=False):
        number = int(path.stem)
        if number != expected:
            findings.append(finding(Code.GAP, path.name, first=expected, last=number - 1))
            before = None
        try:
            entry = read_signed(path, trusted)
        except EvidenceError as error:
            findings += error.findings
            before = None
            continue
        findings += _place_findings(entry, number, before)
        entries.append(entry)
        before = entry
    return Chain(folder, tuple(entries), (*findings, *doubled(entries)))


def _place_findings(entry: Signed, number: int, before: Signed | None) -> Iterator[Finding]:
    """What is wrong with the place of an attestation in its chain, behind the one ``before``."""
    content = entry.content
    if content.number != number:
        yield finding(Code.WRONG_NUMBER, entry.path.name, number=content.number, expected=number)
    times = {"attested": content.attested_at, "signed": entry.signer.signed_at}
    if before is not None:
        if content.previous_sha256 != before.sha256:
            yield finding(Code.BROKEN_LINK, entry.path.name, before=before.path.name)
        times = {
            f"attestation of weld {before.content.number}": before.content.attested_at,
            **times,
        }
    yield from order_findings(entry.path.name, times)


def doubled(entries: Sequence[Signed]) -> list[Finding]:
    """Bags and canisters that are in a chain twice."""
    findings: list[Finding] = []
    bags: dict[str, Attestation] = {}
    canisters: dict[str, Attestation] = {}
    for path, content in ((entry.path, entry.content) for entry in entries):
        hashes, canister = data_files(content.files_sha256), identity_words(content.welded)
        other, earlier = (
            next((bags[key] for key in hashes if key in bags), None),
            canisters.get(canister),
        )
        if other is not None:
            findings.append(
                finding(Code.ATTESTED_TWICE, path.name, number=other.number, bag=other.bag)
            )
        elif canister and earlier is not None and (content.repeats or 0) < earlier.number:
            findings.append(
                finding(Code.CANISTER_TWICE, path.name, identity=canister, number=earlier.number)
            )
        bags |= dict.fromkeys(hashes, content)
        canisters[canister] = content
    return findings


def order_findings(file: str, times: Mapping[str, datetime | None]) -> list[Finding]:
    """What of these events, in their order, is earlier than the one before it; the unknown times are left out."""
    known = [(name, time) for name, time in times.items() if time is not None]
    return [
        finding(
            Code.TIME_ORDER,
            file,
            later=later,
            later_at=later_at,
            earlier=earlier,
            earlier_at=earlier_at,
        )
        for (earlier, earlier_at), (later, later_at) in pairwise(known)
        if later_at < earlier_at - CLOCKS
    ]


def data_files(files_sha256: Mapping[str, str]) -> set[str]:
    """Hashes of the files with the messages."""
    return {value for name, value in files_sha256.items() if name != METADATA_NAME}


def identity_words(identity: Mapping[str, str]) -> str:
    """E.g. ``canister C-1, lid L-7``."""
    return ", ".join(f"{key} {value}" for key, value in identity.items())


def manifest_for(bag: Path) -> tuple[Manifest, str, list[Finding]]:
    """Manifest of a bag and its text, made or completed where the recorder did not, and what there is to say of that.

    Raises
    ------
    BagError
        There is no bag in this folder.
    """
    if not bag.is_dir():
        raise BagError(f"{bag}: is not the folder of a bag; only a folder can be attested")
    manifest, notes = read_manifest(bag), []
    with BagReader(bag) as reader:
        custom = reader.metadata.custom_data
        if manifest is None:
            notes.append(finding(Code.NO_MANIFEST, MANIFEST_NAME))
            attachments = {entry.name: sha256(entry.data) for entry in reader.attachments()}
            manifest = Manifest(
                bag=bag.resolve().name,
                custom_data=custom,
                attachments_sha256=attachments,
                clock=UNKNOWN,
                files=(),
            )
        if source := custom.get("recovered_from"):
            notes.append(finding(Code.RECOVERED, METADATA_NAME, source=source))
        notes += [
            finding(Code.BAG_DAMAGED, bag.name, problem=problem) for problem in reader.problems
        ]
    whole = complete(bag, manifest)
    notes += [
        finding(Code.HASHED_AFTERWARDS, entry.name)
        for entry in whole.files
        if entry.hashed == "afterwards"
    ]
    recorded = whole.files == manifest.files and manifest.files
    return (
        whole,
        (bag / MANIFEST_NAME).read_text(encoding="utf-8") if recorded else whole.text(),
        notes,
    )


def recorder_of(bag: Path, trusted: Sequence[TrustedKey] | None) -> Signer | None:
    """Who signed the manifest when the bag was closed; None where nobody did. An EvidenceError as of `verify_file`."""
    path = bag / MANIFEST_NAME
    return (
        verify_file(path, Purpose.MANIFEST, trusted, path.name)
        if signature_path(path).exists()
        else None
    )


def bag_name(path: Path) -> str:
    """Name of a bag; a folder ``bag`` says nothing, so with that of its parent."""
    whole = path.resolve()
    return f"{whole.parent.name}/{whole.name}" if whole.name == "bag" else whole.name


def software_versions(attachments: Mapping[str, bytes]) -> dict[str, str]:
    """What ``versions.json`` says; empty where there is none."""
    try:
        content = json_content_of(attachments["versions.json"].decode(), "versions.json")
        return {str(key): str(value) for key, value in content.items() if value}
    except (KeyError, ValueError, AttributeError):
        return {}


def statement(bag: Path) -> tuple[list[str], list[str]]:
    """Whether a bag is what was recorded, and who signed for it, in words; and what of that is wrong.

    Any key will do: whose it is, the reader of its fingerprint has to say.
    """
    try:
        manifest = read_manifest(bag) if bag.is_dir() else None
    except BagError as error:
        return [str(error)], [str(error)]
    if manifest is None:
        return [f"no {MANIFEST_NAME}: whether the files are what was recorded is not known"], []
    if findings := check_files(bag, manifest):
        text = f"not as {MANIFEST_NAME} has it: {summary(findings)}"
        return [text], [text]
    late = (
        ", hashed after the recording"
        if any(entry.hashed == "afterwards" for entry in manifest.files)
        else ""
    )
    lines = [f"{len(manifest.files)} files as {MANIFEST_NAME} has them{late}"]
    try:
        recorder = recorder_of(bag, None)
        lines.append(
            f"{MANIFEST_NAME} signed by {recorder.words}"
            if recorder
            else f"{MANIFEST_NAME} is not signed"
        )
        if not (bag / ATTESTATION_NAME).exists():
            return [*lines, "not attested when this was written"], []
        signed = read_signed(bag / ATTESTATION_NAME, None)
        if wrong := [
            *other_identity(bag, signed.content),
            *manifest_findings(bag, signed.content),
        ]:
            raise EvidenceError(*wrong)
    except MissingExtraError as error:
        return [*lines, f"signatures cannot be checked: {error}"], []
    except InputError as error:
        text = f"not as it was signed: {error}"
        return [*lines, text], [text]
    return [*lines, f"attested as weld {signed.content.number} by {signed.signer.words}"], []


def other_identity(bag: Path, attested: Attestation) -> list[Finding]:
    """Where the bag says that something else was welded than what was attested."""
    try:
        custom = read_metadata(bag).custom_data
    except BagError:
        return []
    return [
        finding(
            Code.OTHER_IDENTITY,
            ATTESTATION_NAME,
            field=name,
            stated=value,
            actual=custom.get(name, "none"),
        )
        for name, value in attested.identity.items()
        if custom.get(name) != value
    ]


def manifest_findings(bag: Path, attested: Attestation) -> list[Finding]:
    """The files of the bag against the manifest that was attested; without that, against their hashes alone."""
    try:
        if sha256(read_regular(bag / MANIFEST_NAME)) == attested.manifest_sha256:
            manifest = read_manifest(bag)
            return check_files(bag, manifest) if manifest else []
        findings = [finding(Code.OTHER_MANIFEST, MANIFEST_NAME)]
    except OSError as error:
        findings = [finding(Code.UNREADABLE, MANIFEST_NAME, reason=error.strerror)]
    for name, digest in attested.files_sha256.items():
        try:
            if sha256(mapped(bag / name)) != digest:
                findings.append(finding(Code.CHANGED, name))
        except OSError as error:
            findings.append(finding(Code.UNREADABLE, name, reason=error.strerror))
    return findings


def weld_times(manifest: Manifest) -> tuple[datetime | None, datetime | None]:
    """When the first and the last message were received, by the computer's clock; None for a simulated clock."""
    stamps_ns = [
        piece.begin_ns
        for file in manifest.files
        for piece in file.pieces
        if piece.begin_ns is not None
    ]
    stamps_ns += [
        piece.end_ns
        for file in manifest.files
        for piece in file.pieces
        if piece.end_ns is not None
    ]
    if (
        not stamps_ns or min(stamps_ns) < 10**18
    ):  # the year 2001: stamps of a simulation count from 0
        return None, None
    first, last = (
        datetime.fromtimestamp(stamp_ns * 1e-9, UTC)
        for stamp_ns in (min(stamps_ns), max(stamps_ns))
    )
    return first, last
