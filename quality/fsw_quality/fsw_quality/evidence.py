"""Attests bags and verifies what was attested; nothing is signed that does not fit together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path, PurePosixPath

from fsw_analysis.procedure import Procedure, attached
from fsw_control.schema.files import locked, read_regular, write_whole
from fsw_control.schema.models import InputError
from fsw_quality.attestation import (
    ATTESTATION_NAME,
    IDENTITY,
    Attestation,
    Chain,
    Signed,
    bag_name,
    identity_words,
    manifest_findings,
    manifest_for,
    order_findings,
    other_identity,
    read_chain,
    read_signed,
    recorder_of,
    software_versions,
    weld_times,
)
from fsw_quality.cross_check import Weld, check_documents, page_findings, records_of
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_reader import SUFFIXES, BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, EvidenceError, Finding, finding
from fsw_recorder.manifest import MANIFEST_NAME, Manifest, mapped, read_manifest, sha256
from fsw_recorder.manifest_check import check_files
from fsw_recorder.signature import (
    Purpose,
    Signer,
    SigningKey,
    TrustedKey,
    check_revocation,
    check_trust,
    fingerprint,
    sign,
    signature_path,
)

#: what an attestation may note although the recorder cannot answer for it, where that is allowed
_AFTERWARDS = (Code.NO_MANIFEST, Code.HASHED_AFTERWARDS, Code.RECOVERED)


@dataclass(frozen=True, slots=True)
class Policy:
    """What has to be, or may be, when a bag is attested or verified."""

    trusted: Sequence[TrustedKey] = ()
    require_signed: bool = False
    """the manifest by the recorder, and the procedure"""
    afterwards: bool = False
    """also a bag whose recorder did not hash all of it"""
    repeat: bool = False
    """also a canister that was welded already"""


@dataclass(frozen=True, slots=True)
class Subject:
    """What is signed for: a bag, the procedure of its weld with its signer, and documents."""

    bag: Path
    procedure: Procedure | None = None
    procedure_signer: Signer | None = None
    documents: Sequence[Path] = ()

    def contents(self) -> dict[str, bytes]:
        """Documents by the names that an attestation lists them by."""
        keys = [document_key(self.bag, path) for path in self.documents]
        if doubled := next((key for key in keys if keys.count(key) > 1), None):
            raise EvidenceError(finding(Code.DOUBLED_NAME, doubled))
        return {key: bytes(mapped(path)) for key, path in zip(keys, self.documents, strict=True)}


def document_key(bag: Path, path: Path) -> str:
    """Where a document is in the folder of the bag; else its name."""
    whole, home = path.resolve(), bag.resolve()
    return whole.relative_to(home).as_posix() if whole.is_relative_to(home) else path.name


def attest(
    subject: Subject,
    chain_folder: Path,
    key: SigningKey,
    now: datetime,
    policy: Policy = Policy(),
    progress: Callable[[float], None] | None = None,
) -> Attestation:
    """Sign for a bag and add it to a chain. After a crash in between, the same call ends what was begun.

    The chain's folder is made when there is none.

    Raises
    ------
    EvidenceError
        Something does not fit together, or with the policy; its findings say what.
    BagError
        There is no bag, it cannot be read, or it is in the chain already.
    """
    now = now.replace(microsecond=0)
    own = TrustedKey(name="", key=key.public)
    listed = fingerprint(own.key) in {fingerprint(entry.key) for entry in policy.trusted}
    trusted = (*policy.trusted, *(() if listed else (own,)))
    check_trust(
        Signer(key=fingerprint(own.key), signed_at=now),
        Purpose.ATTESTATION,
        trusted,
        ATTESTATION_NAME,
    )
    text, draft = _draft(subject, now, policy, progress)
    with locked(chain_folder):
        chain = read_chain(chain_folder, trusted)
        if chain.findings:
            raise EvidenceError(*chain.findings)
        if (entry := chain.of(draft.files_sha256)) is not None:
            return _end(subject.bag, text, draft.files_sha256, entry)
        last = chain.entries[-1] if chain.entries else None
        made = draft.changed(
            number=last.content.number + 1 if last else 1,
            previous_sha256=last.sha256 if last else None,
            repeats=_repeated(draft, chain, policy),
        )
        signed = sign(made.text().encode(), ATTESTATION_NAME, Purpose.ATTESTATION, key, now)
        _write(subject.bag, chain_folder / f"{made.number:06d}.json", text, made.text(), signed)
    return made


def _draft(
    subject: Subject, now: datetime, policy: Policy, progress: Callable[[float], None] | None
) -> tuple[str, Attestation]:
    """Text of the manifest, and what is to be signed, but for its place in the chain; an EvidenceError as `attest`."""
    bag, contents = subject.bag, subject.contents()
    manifest, text, notes = manifest_for(bag)
    findings = check_files(bag, manifest)
    if not policy.afterwards:
        findings += [note for note in notes if note.code in _AFTERWARDS]
    with BagReader(bag) as reader:
        attachments = {entry.name: entry.data for entry in reader.attachments()}
    weld = Weld(bag, manifest, attached(attachments), subject.procedure)
    recorder = None
    try:
        recorder = recorder_of(bag, policy.trusted or (() if policy.require_signed else None))
    except EvidenceError as error:
        findings += error.findings
    for name, signer in ((MANIFEST_NAME, recorder), ("procedure", subject.procedure_signer)):
        if signer and (entry := check_revocation(signer, [now], policy.trusted, name)):
            findings.append(entry)
    procedure = weld.procedure
    notes += _unsigned(procedure, subject.procedure_signer, recorder)
    if procedure is not None and not weld.attached:
        notes.append(finding(Code.PROCEDURE_NOT_RECORDED, procedure.id))
    if policy.require_signed:
        findings += [
            note
            for note in notes
            if note.code in (Code.MANIFEST_UNSIGNED, Code.PROCEDURE_UNSIGNED)
        ]
    findings += weld.findings(METADATA_NAME)
    findings += order_findings(ATTESTATION_NAME, _times(manifest, recorder, now))
    if not findings:  # else no document can be compared
        findings, foreign = check_documents(weld, contents, progress)
        notes += foreign
    if findings:
        raise EvidenceError(*findings)
    return (
        text,
        Attestation(
            number=0,
            bag=bag_name(bag),
            identity={
                name: manifest.custom_data[name]
                for name in IDENTITY
                if name in manifest.custom_data
            },
            manifest_sha256=sha256(text.encode()),
            recorder=recorder,
            files_sha256={entry.name: entry.sha256 for entry in manifest.files},
            attachments_sha256=manifest.attachments_sha256,
            procedure=procedure.identity if procedure else None,
            procedure_signer=subject.procedure_signer,
            software=software_versions(attachments),
            documents_sha256={name: sha256(data) for name, data in contents.items()},
            notes=tuple(notes),
            attested_at=now,
        ),
    )


def _unsigned(
    procedure: object, procedure_signer: Signer | None, recorder: Signer | None
) -> Iterator[Finding]:
    """What nobody signed of manifest and procedure; ``procedure`` has an ``id``, or is None."""
    if recorder is None:
        yield finding(Code.MANIFEST_UNSIGNED, MANIFEST_NAME)
    if procedure_signer is None:
        yield finding(
            Code.PROCEDURE_UNSIGNED, ATTESTATION_NAME, id=getattr(procedure, "id", "(none)")
        )


def _times(
    manifest: Manifest | None, recorder: Signer | None, now: datetime
) -> Mapping[str, datetime | None]:
    end = weld_times(manifest)[1] if manifest else None
    return {
        "end of the weld": end,
        "manifest signed": recorder.signed_at if recorder else None,
        "attested": now,
    }


def _repeated(draft: Attestation, chain: Chain, policy: Policy) -> int | None:
    """Number of the last earlier weld of this canister; an EvidenceError where that may not be."""
    earlier = [
        entry.content.number
        for entry in chain.entries
        if draft.welded and entry.content.welded == draft.welded
    ]
    if earlier and not policy.repeat:
        words = identity_words(draft.welded)
        raise EvidenceError(
            finding(Code.CANISTER_TWICE, draft.bag, identity=words, number=earlier[-1])
        )
    return earlier[-1] if earlier else None


def _write(bag: Path, entry: Path, manifest_text: str, text: str, signed: str) -> None:
    """Write an attestation into its chain and its bag, its signature first: one without is never seen."""
    copy = bag / ATTESTATION_NAME
    for path, content in (
        (signature_path(entry), signed),
        (entry, text),
        (bag / MANIFEST_NAME, manifest_text),
        (signature_path(copy), signed),
        (copy, text),
    ):
        write_whole(path, content, durable=True)


def _end(
    bag: Path, manifest_text: str, files_sha256: Mapping[str, str], entry: Signed
) -> Attestation:
    """Put into a bag what is in the chain already; an EvidenceError where that has been done, or for other files."""
    content = entry.content
    if (bag / ATTESTATION_NAME).exists() or content.files_sha256 != files_sha256:
        raise EvidenceError(
            finding(Code.ATTESTED_TWICE, bag, number=content.number, bag=content.bag)
        )
    if content.manifest_sha256 != sha256(manifest_text.encode()):
        raise EvidenceError(finding(Code.OTHER_MANIFEST, bag))
    _write(
        bag,
        entry.path,
        manifest_text,
        entry.data.decode(),
        read_regular(signature_path(entry.path)).decode(),
    )
    return content


@dataclass(slots=True)
class Verification:
    """Result for a bag: what was attested, by whom, what is wrong, and what was not checked."""

    bag: Path
    attested: Attestation | None = None
    signers: dict[Purpose, Signer] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    not_checked: list[Finding] = field(default_factory=list)


def verify_bag(
    bag: Path,
    policy: Policy,
    now: datetime,
    chain: Chain | None = None,
    documents: Sequence[Path] = (),
) -> Verification:
    """Whether a bag is what was recorded and signed, has its place in the ``chain``, and with it its documents.

    Documents that were attested are looked for among ``documents`` and in the folder of the bag.
    """
    result = Verification(bag)
    if not bag.is_dir():
        result.findings.append(finding(Code.UNREADABLE, bag, reason="is not the folder of a bag"))
        return result
    try:
        signed = read_signed(bag / ATTESTATION_NAME, policy.trusted)
    except EvidenceError as error:
        result.findings += error.findings
        return result
    except InputError as error:
        result.findings.append(finding(Code.UNREADABLE, ATTESTATION_NAME, reason=error))
        return result
    result.attested, result.signers[Purpose.ATTESTATION] = signed.content, signed.signer
    result.findings += _other_weld(bag, signed.content)
    if not result.findings:
        result.findings += other_identity(bag, signed.content) + manifest_findings(
            bag, signed.content
        )
        _check_signers(result, policy, now)
        _check_documents(result, documents)
        _check_place(result, signed, chain)
        _check_revocations(result, policy, chain)
    if not any(entry.name for entry in policy.trusted):
        result.not_checked.append(finding(Code.ALL_KEYS, ATTESTATION_NAME))
    return result


def _other_weld(bag: Path, attested: Attestation) -> list[Finding]:
    listed = [name for name in attested.files_sha256 if name != METADATA_NAME]
    others = any(
        path.name.endswith(SUFFIXES) and path.name not in listed for path in bag.iterdir()
    )
    if not others or any((bag / name).exists() for name in listed):
        return []
    words = "".join(f", {key} {value}" for key, value in attested.identity.items())
    return [finding(Code.OTHER_WELD, ATTESTATION_NAME, bag=attested.bag, identity=words)]


def _check_signers(result: Verification, policy: Policy, now: datetime) -> None:
    """Who signed manifest and procedure, and whether all times are in order."""
    attested, bag = result.attested, result.bag
    assert attested is not None
    try:
        manifest, recorder = read_manifest(bag), recorder_of(bag, policy.trusted)
    except (BagError, EvidenceError) as error:
        result.findings += getattr(error, "findings", ())
        manifest = recorder = None
    else:
        stated = attested.recorder
        if (recorder.key if recorder else "nobody") != (stated.key if stated else "nobody"):
            key, name = recorder.key if recorder else "none", stated.words if stated else "nobody"
            result.findings.append(finding(Code.OTHER_SIGNER, MANIFEST_NAME, key=key, stated=name))
    if recorder:
        result.signers[Purpose.MANIFEST] = recorder
    if attested.procedure_signer:
        try:
            signer = check_trust(
                attested.procedure_signer, Purpose.PROCEDURE, policy.trusted, "procedure"
            )
            result.signers[Purpose.PROCEDURE] = signer
        except EvidenceError as error:
            result.findings += error.findings
    unsigned = list(_unsigned(attested.procedure, attested.procedure_signer, attested.recorder))
    (result.findings if policy.require_signed else result.not_checked).extend(unsigned)
    result.not_checked += [
        note for note in attested.notes if note.code is Code.PROCEDURE_NOT_RECORDED
    ]
    if manifest is None or not manifest.clock.synchronized:
        result.not_checked.append(finding(Code.CLOCK_UNKNOWN, MANIFEST_NAME))
    times = {**_times(manifest, recorder, attested.attested_at), "this verification": now}
    result.findings += order_findings(ATTESTATION_NAME, times)
    if attested.procedure_signer and manifest:
        begin = {
            "procedure signed": attested.procedure_signer.signed_at,
            "begin of the weld": weld_times(manifest)[0],
        }
        result.findings += order_findings(ATTESTATION_NAME, begin)


def _check_revocations(result: Verification, policy: Policy, chain: Chain | None) -> None:
    """Signatures by keys that were revoked since: others must have signed for them before."""
    attested, last = result.attested, result.signers[Purpose.ATTESTATION]
    assert attested is not None
    later = [
        entry.signer
        for entry in (chain.entries if chain else ())
        if entry.content.number > attested.number
    ]
    for purpose, signer in result.signers.items():
        covering = later if purpose is Purpose.ATTESTATION else [last, *later]
        shown_at = [other.signed_at for other in covering if other.key != signer.key]
        if entry := check_revocation(signer, shown_at, policy.trusted, purpose.value):
            unknown = entry.code is Code.REVOCATION_BY_OWN_CLOCK
            (result.not_checked if unknown else result.findings).append(entry)


def _check_documents(result: Verification, documents: Sequence[Path]) -> None:
    """Every document that was attested, as far as it is here, and those that were not."""
    attested, bag = result.attested, result.bag
    assert attested is not None
    given: dict[str, Path] = {}
    for path in documents:
        keys = {
            document_key(bag, path),
            *(key for key in attested.documents_sha256 if key.endswith(f"/{path.name}")),
        }
        if key := next((key for key in sorted(keys) if key in attested.documents_sha256), ""):
            given[key] = path
        else:
            result.findings.append(finding(Code.NOT_ATTESTED, path, number=attested.number))
    contents: dict[str, bytes] = {}
    foreign = {note.file for note in attested.notes if note.code is Code.DOCUMENT_FOREIGN}
    for key, digest in attested.documents_sha256.items():
        path = given.get(key, bag / PurePosixPath(key))
        try:
            contents[key] = bytes(mapped(path))
        except OSError:
            (result.findings if key in given else result.not_checked).append(
                finding(Code.DOCUMENT_ABSENT, key)
            )
            continue
        if sha256(contents[key]) != digest:
            del contents[key]
            result.findings.append(finding(Code.DOCUMENT_CHANGED, path, number=attested.number))
        code = Code.DOCUMENT_FOREIGN if key in foreign else Code.NOT_JUDGED_AGAIN
        result.not_checked.append(finding(code, key))
    try:
        records = records_of(contents)
    except InputError as error:
        result.findings.append(finding(Code.UNREADABLE, ATTESTATION_NAME, reason=error))
        return
    if records:  # else the record is not here, which was said
        result.findings += page_findings(contents, records)


def _check_place(result: Verification, signed: Signed, chain: Chain | None) -> None:
    """The place in the chain."""
    if chain is None:
        result.not_checked.append(finding(Code.NO_CHAIN, ATTESTATION_NAME))
        return
    entries = {entry.content.number: entry for entry in chain.entries}
    entry = entries.get(signed.content.number)
    if entry is None:
        result.findings.append(
            finding(Code.NOT_IN_CHAIN, chain.folder, number=signed.content.number)
        )
    elif entry.data != signed.data:
        result.findings.append(
            finding(Code.OTHER_IN_CHAIN, entry.path.name, bag=entry.content.bag)
        )
