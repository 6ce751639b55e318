"""Attests bags and verifies what was attested; nothing is signed that does not fit together."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from fsw_analysis.procedure import Procedure, attached
from fsw_control.schema.files import locked, write_whole
from fsw_control.schema.models import Many, Model, json_content_of, validate
from fsw_quality import record_hook
from fsw_quality.attestation import Attestation, Chain, order_findings, tried, weld_times
from fsw_quality.record import make
from fsw_quality.record_content import Record, bag_name, other_version
from fsw_quality.report import JSON, PAGE, PDF, contents, json_sha256, record_bytes
from fsw_recorder import manifest as manifests
from fsw_recorder import signature
from fsw_recorder.bag_metadata import ATTESTATION_NAME, IDENTITY, METADATA_NAME
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, EvidenceError, Finding, Unchecked, finding
from fsw_recorder.manifest import MANIFEST_NAME, Manifest, mapped, read_manifest, sha256
from fsw_recorder.signature import Purpose, Signer, Statement, TrustedKey

if TYPE_CHECKING:  # from the extra signing
    from securesystemslib.signer import CryptoSigner

#: Faults only where signatures are required. Without them a bag with no manifest, whose recorder
#: was killed, is proven by no less than one with an unsigned manifest, which anybody can write
_UNSIGNED = {
    Code.NO_MANIFEST,
    Code.MANIFEST_UNSIGNED,
    Code.PROCEDURE_UNSIGNED,
    Code.PROCEDURE_ABSENT,
}
#: fields of a record that the bag alone does not give, and what is noted of them
_BESIDE: dict[str, Unchecked | None] = {
    "bag": None,
    "comparison": Unchecked.NOT_COMPARED,
    "afterwards": Unchecked.STATED_AFTERWARDS,
}
#: fields that differ where a record is not merely edited, but of something else
_OTHER = {
    "files": Code.RECORD_OTHER_WELD,
    "procedure": Code.RECORD_OTHER_PROCEDURE,
    "identity": Code.RECORD_OTHER_IDENTITY,
}


class Policy(NamedTuple):
    """What has to be when a bag is attested or verified."""

    trusted: Sequence[TrustedKey]
    require_signed: bool = False  #: the manifest by the recorder, and the procedure

    def is_fault(self, entry: Finding) -> bool:
        """Whether a finding refuses a bag; else it is noted."""
        noted = set() if self.require_signed else _UNSIGNED
        return isinstance(entry.code, Code) and entry.code not in noted


class Subject(NamedTuple):
    """What is signed for: a bag, the procedure of its weld with its signer, and the record."""

    bag: Path
    procedure: Procedure | None = None
    procedure_signer: Signer | None = None
    record: Path | None = None  #: its folder; left out: ``record`` in that of the bag, if any


def attest(
    subject: Subject,
    chain_folder: Path,
    key: CryptoSigner,
    now: datetime,
    policy: Policy,
    progress: Callable[[float], None] | None = None,
) -> Attestation:
    """Sign for a bag and add it to a chain, whose folder is made when there is none.

    Raises
    ------
    EvidenceError
        Something does not fit together, or with the policy; its findings say what.
    BagError
        There is no bag, or it cannot be read.
    """
    bag, now, line = subject.bag, now.replace(microsecond=0), key.public_key.keyid
    own = Signer(key=signature.fingerprint(line), signed_at=now)
    if not bag.is_dir():
        raise BagError(f"{bag}: is not the folder of a bag; only a folder can be attested")
    folder = os.path.relpath((subject.record or bag / "record").resolve(), bag.resolve())
    names = [f"{folder}/{name}" for name in (JSON, PAGE, PDF) if (bag / folder / name).exists()]
    documents = {name: bytes(mapped(bag / name)) for name in names}
    manifest = read_manifest(bag)
    with BagReader(bag) as reader:
        custom, findings = reader.metadata.custom_data, [*_recorded(bag, manifest, reader)]
        ran_by = attached({entry.name: entry.data for entry in reader.attachments()})
    procedure = subject.procedure or (ran_by[0] if len(ran_by) == 1 else None)
    if procedure and procedure.sha256 not in {entry.sha256 for entry in ran_by}:
        code = Code.OTHER_PROCEDURE if ran_by else Unchecked.PROCEDURE_NOT_RECORDED
        findings.append(finding(code, METADATA_NAME, **dict(procedure.identity)))
    draft = Attestation(
        signed_at=now,
        number=0,
        bag=bag_name(bag),
        identity={name: custom[name] for name in IDENTITY if name in custom},
        procedure=procedure.identity if procedure else None,
        procedure_signer=subject.procedure_signer,
        documents=tuple(documents),
        notes=(),
    )
    _check_signers(findings, bag, manifest, draft, own, policy)
    if not documents:
        absent = Code.MISSING if subject.record else Unchecked.NO_RECORD
        findings.append(finding(absent, f"{folder}/{JSON}"))
    elif not any(map(policy.is_fault, findings)):  # else they cannot be compared
        findings += _check_documents(bag, procedure, documents, progress)
    if faults := [*filter(policy.is_fault, findings)]:
        raise EvidenceError(*faults)
    hashes = {path.name: sha256(mapped(path)) for path in _files(bag)}
    hashes |= {name: sha256(data) for name, data in documents.items()}
    with locked(chain_folder):
        chain = Chain(chain_folder, policy.trusted)
        number, before = len(chain.entries) + 1, chain.last_sha256
        made = draft.changed(number=number, previous_sha256=before, notes=tuple(findings))
        data = signature.envelope(hashes, Purpose.ATTESTATION, made, key).encode()
        path = chain_folder / f"{number:06d}.json"
        chain.add(path, data)
        if chain.findings:
            raise EvidenceError(*chain.findings)
        # The chain is written last: before that the same call makes the same attestation again.
        for target in (bag / ATTESTATION_NAME, path):
            write_whole(target, data, durable=True)
    return made


def _files(bag: Path) -> list[Path]:
    """What of a folder is the bag: what a reader uses, the manifest and its signature."""
    names = (MANIFEST_NAME, signature.signature_path(Path(MANIFEST_NAME)).name)
    return [path for path in bag.iterdir() if manifests.is_read(path.name) or path.name in names]


def _recorded(bag: Path, manifest: Manifest | None, reader: BagReader) -> Iterator[Finding]:
    """Whether the files are what the recorder wrote."""
    if manifest is None:
        yield finding(Code.NO_MANIFEST, MANIFEST_NAME)
    else:
        yield from manifests.check_files(bag, manifest)
        late = [entry.name for entry in manifest.files if entry.hashed == "afterwards"]
        yield from (finding(Code.HASHED_AFTERWARDS, name) for name in late)
    if source := reader.metadata.custom_data.get("recovered_from"):
        yield finding(Code.RECOVERED, METADATA_NAME, source=source)
    if manifest is None or not manifest.clock.synchronized:
        yield finding(Unchecked.CLOCK_UNKNOWN, MANIFEST_NAME)
    for problem in reader.problems:
        yield finding(Unchecked.BAG_DAMAGED, bag.name, problem=problem)


def _check_documents(
    bag: Path,
    procedure: Procedure | None,
    documents: Mapping[str, bytes],
    progress: Callable[[float], None] | None = None,
) -> Iterator[Finding]:
    """Whether documents, first the record, then its pages, are what bag and procedure give.

    Reads the whole bag for that.

    Raises
    ------
    fsw_control.schema.models.InputError
        A record cannot be read, or the PDF's extra is missing.
    fsw_recorder.errors.BagError
        The bag cannot be judged.
    """
    name, *pages = documents
    if Path(name).name != JSON:
        yield finding(Code.MISSING, JSON)
        return
    data = documents[name]
    content = json_content_of(data.decode("utf-8", "replace"), name)
    if wrong := other_version(content, name):
        yield wrong
        return
    if procedure is None:
        yield finding(Code.NO_PROCEDURE, name)
        return
    stated = validate(Record, content, name)
    beside = {key: getattr(stated, key) for key in _BESIDE}
    for key, note in _BESIDE.items():
        if note and beside[key] is not None:
            yield finding(note, name)
    # All else follows from bag and procedure, so what was edited differs from what is made
    # again; no list of fields or sentences to check can be incomplete.
    made, course = make(bag, procedure, progress)
    made = made.changed(**beside)
    if data != record_bytes(made):
        claimed, real = (entry.model_dump(mode="json") for entry in (stated, made))
        # bytes: e.g. a key that is given twice, of which other software may read the first
        fields = [key for key in real if real[key] != claimed[key]] or ["bytes"]
        code = next((_OTHER[key] for key in _OTHER if key in fields), Code.RECORD_EDITED)
        yield finding(code, name, fields=", ".join(fields))
    if PDF in map(os.path.basename, pages):
        record_hook.PDF.need("the PDF of a record")
    again = contents(made, course, procedure).values() if pages else ()
    for page in pages:
        if documents[page] not in again:
            is_edited = json_sha256(documents[page]) == sha256(data)
            yield finding(Code.DOCUMENT_DIFFERS if is_edited else Code.OTHER_RECORD, page)


def _check_signers(
    flaws: list[Finding],
    bag: Path,
    manifest: Manifest | None,
    stated: Attestation,
    attester: Signer,
    policy: Policy,
    later: Sequence[Signer] = (),
    now: datetime | None = None,
) -> dict[Purpose, Signer]:
    """Signers.

    Finds which signatures do not count, also by a key revoked since, or are not in order.

    ``later`` signed attestations that follow this one.
    """
    at, signers = dict[Purpose, datetime](), dict[Purpose, Signer]()
    machine = tried(flaws, bag, signature.signer_of, bag / MANIFEST_NAME, Purpose.MANIFEST, None)
    no_procedure = Code.PROCEDURE_UNSIGNED if stated.procedure else Code.PROCEDURE_ABSENT
    revoked = {signature.fingerprint(key.key) for key in policy.trusted if key.revoked}
    for purpose, signer, unsigned in (
        (Purpose.ATTESTATION, attester, Code.NOT_SIGNED),
        (Purpose.MANIFEST, machine, Code.MANIFEST_UNSIGNED),
        (Purpose.PROCEDURE, stated.procedure_signer, no_procedure),
    ):
        if signer is None:
            flaws.append(finding(unsigned, purpose))
            continue
        others = [other.signed_at for other in (attester, *later) if other.key != signer.key]
        use = signer, purpose, policy.trusted, purpose, min(others, default=None)
        if by := tried(flaws, bag, signature.check_trust, *use):
            at[purpose] = by.signed_at
            if by.key in revoked and not others:
                flaws.append(finding(Unchecked.REVOCATION_BY_OWN_CLOCK, purpose, **dict(by)))
        signers[purpose] = by or signer
    begin, end = weld_times(manifest) if manifest else (None, None)
    times = {
        "procedure signed": at.get(Purpose.PROCEDURE),
        "begin of the weld": begin,
        "end of the weld": end,
        "manifest signed": at.get(Purpose.MANIFEST),
        "attested": at.get(Purpose.ATTESTATION),
        "this verification": now,
    }
    flaws += order_findings(ATTESTATION_NAME, times)
    return signers


class Verification(Model):
    """Result for a bag: what was attested, by whom, what is wrong, and what was not checked."""

    bag: Path
    attested: Attestation | None = None
    signers: dict[Purpose, Signer]
    findings: Many[Finding]
    not_checked: Many[Finding]


def verify_bag(
    bag: Path, policy: Policy, now: datetime, chain: Chain | None = None
) -> Verification:
    """Whether a bag and its documents are as recorded and signed, and in the ``chain``."""
    findings, signers, made = list[Finding](), dict[Purpose, Signer](), None
    data = tried(findings, bag, signature.read_file, bag / ATTESTATION_NAME)
    kind = Purpose.ATTESTATION, Attestation, policy.trusted, ATTESTATION_NAME
    if data is not None and (signed := tried(findings, bag, signature.open_envelope, data, *kind)):
        made, entries = signed.predicate, chain.entries if chain else []
        later = [entry.signer for entry in entries if entry.predicate.number > made.number]
        manifest = tried(findings, bag, read_manifest, bag)
        by = bag, manifest, made, signed.signer, policy, later, now
        signers = _check_signers(findings, *by)
        for name in signed.sha256:
            findings += tried(findings, bag / name, _check_file, bag, name, signed, manifest) or []
        others = [path for path in _files(bag) if path.name not in signed.sha256]
        findings += [finding(Code.NOT_ATTESTED, path) for path in others]
        findings += [note for note in made.notes if note not in findings]
        if chain and signed.data not in {entry.data for entry in entries}:
            findings.append(finding(Code.NOT_IN_CHAIN, chain.folder, number=made.number))
    dated = any(key.valid_from or key.valid_until or key.revoked for key in policy.trusted)
    for code, applies in (
        (Unchecked.FILES_NOT_CHECKED, made is None),
        (Unchecked.NOT_JUDGED_AGAIN, made and made.documents),
        (Unchecked.NO_CHAIN, made and chain is None),
        (Unchecked.ALL_KEYS, made and not dated),
    ):
        findings += [finding(code, bag)] if applies else []
    faults = tuple(filter(policy.is_fault, findings))
    rest = tuple(entry for entry in findings if entry not in faults)
    return Verification(bag=bag, attested=made, signers=signers, findings=faults, not_checked=rest)


def _check_file(
    bag: Path, name: str, signed: Statement[Attestation], manifest: Manifest | None
) -> list[Finding]:
    """What of an attested file is not as it was: of one of the bag to the chunk."""
    path, digest = bag / name, signed.sha256[name]
    if not path.is_file():
        is_document = name in signed.predicate.documents
        return [finding(Unchecked.DOCUMENT_ABSENT if is_document else Code.MISSING, name)]
    if sha256(mapped(path)) == digest:
        return []
    # the manifest locates the change, if it is about the file that was attested
    listed = [entry for entry in manifest.files if entry.name == name] if manifest else []
    if listed and listed[0].sha256 == digest:
        return manifests.check_file(path, listed[0])
    return [finding(Code.CHANGED_SINCE, name)]
