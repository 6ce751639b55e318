"""Attests bags and verifies what was attested; nothing is signed that does not fit together."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fsw_analysis.procedure import Procedure, attached
from fsw_control.schema.files import locked, write_whole
from fsw_control.schema.models import Many, Model
from fsw_quality.attestation import (
    Attestation,
    Chain,
    Signed,
    chain_findings,
    opened,
    order_findings,
    read_chain,
    tried,
    weld_times,
)
from fsw_quality.cross_check import check_documents
from fsw_quality.record_content import bag_name
from fsw_quality.report import json_sha256
from fsw_recorder import signature
from fsw_recorder.bag_metadata import ATTESTATION_NAME, IDENTITY, METADATA_NAME
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, EvidenceError, Finding, Unchecked, finding
from fsw_recorder.manifest import MANIFEST_NAME, Manifest, mapped, read_manifest, sha256
from fsw_recorder.manifest_check import check_file, check_files, is_read
from fsw_recorder.signature import Purpose, Signer, TrustedKey, read_file

if TYPE_CHECKING:  # from the extra signing
    from securesystemslib.signer import CryptoSigner

#: faults only where the recorder must answer for all of the bag
_AFTERWARDS = {Code.NO_MANIFEST, Code.UNLISTED, Code.HASHED_AFTERWARDS, Code.RECOVERED}
#: faults only where signatures are required
_UNSIGNED = {Code.MANIFEST_UNSIGNED, Code.PROCEDURE_UNSIGNED, Code.PROCEDURE_ABSENT}


@dataclass(frozen=True, slots=True)
class Policy:
    """What has to be, or may be, when a bag is attested or verified."""

    trusted: Sequence[TrustedKey]
    require_signed: bool = False
    """the manifest by the recorder, and the procedure"""
    afterwards: bool = False
    """also a bag whose recorder did not hash all of it"""
    repeat: bool = False
    """also a canister that was welded already"""

    def is_fault(self, entry: Finding) -> bool:
        """Whether a finding refuses a bag; else it is noted."""
        is_noted = (self.afterwards and entry.code in _AFTERWARDS) or (
            not self.require_signed and entry.code in _UNSIGNED
        )
        return isinstance(entry.code, Code) and not is_noted


@dataclass(frozen=True, slots=True)
class Subject:
    """What is signed for: a bag, the procedure of its weld with its signer, and documents."""

    bag: Path
    procedure: Procedure | None = None
    procedure_signer: Signer | None = None
    documents: Sequence[Path] = ()


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
    own = Signer(
        key=signature.fingerprint(key.public_key.keyid), signed_at=now.replace(microsecond=0)
    )
    hashes, draft = _draft(subject, own, policy, progress)
    with locked(chain_folder):
        chain = read_chain(chain_folder, policy.trusted)
        number = len(chain.entries) + 1
        made = draft.changed(number=number, previous_sha256=chain.last_sha256)
        stated = made.model_dump(mode="json", exclude_none=True)
        data = signature.envelope(hashes, Purpose.ATTESTATION, stated, key).encode()
        path = chain_folder / f"{number:06d}.json"
        entry = opened(path, data, policy.trusted, chain.last_sha256)
        wrong = chain.findings or tuple(chain_findings([*chain.entries, entry]))
        if wrong or path.exists():  # there is one where a file was renamed
            raise EvidenceError(*wrong or [finding(Code.BROKEN_LINK, path.name, number=number)])
        # The chain is written last: before that the same call makes the same attestation again.
        for target in (subject.bag / ATTESTATION_NAME, path):
            write_whole(target, data, durable=True)
    return made


def _draft(
    subject: Subject, own: Signer, policy: Policy, progress: Callable[[float], None] | None
) -> tuple[dict[str, str], Attestation]:
    """Hashes and statement that are to be signed, but for the place in the chain; an EvidenceError as `attest`."""
    bag, signer = subject.bag, subject.procedure_signer
    if not bag.is_dir():
        raise BagError(f"{bag}: is not the folder of a bag; only a folder can be attested")
    # named by their path from the bag, so that no two of them have one name, also behind links
    own_files = {path.resolve() for path in _files(bag)}
    others = [path.resolve() for path in subject.documents if path.resolve() not in own_files]
    paths = {Path(os.path.relpath(path, bag.resolve())).as_posix(): path for path in others}
    documents = {name: bytes(mapped(path)) for name, path in paths.items()}
    manifest = read_manifest(bag)
    with BagReader(bag) as reader:
        custom, found = reader.metadata.custom_data, [*_recorded(bag, manifest, reader)]
        ran_by = attached({entry.name: entry.data for entry in reader.attachments()})
    procedure = subject.procedure or (ran_by[0] if len(ran_by) == 1 else None)
    if procedure and procedure.sha256 not in {entry.sha256 for entry in ran_by}:
        by = dict(procedure.identity)
        if ran_by:
            found.append(finding(Code.OTHER_PROCEDURE, METADATA_NAME, **by))
        else:
            found.append(finding(Unchecked.PROCEDURE_NOT_RECORDED, METADATA_NAME, **by))
    signers = {Purpose.ATTESTATION: own} | ({Purpose.PROCEDURE: signer} if signer else {})
    found += _check_signers(bag, manifest, procedure, signers, policy)
    if not any(map(policy.is_fault, found)):  # else no document can be compared
        found += check_documents(bag, procedure, documents, progress)
    if faults := [*filter(policy.is_fault, found)]:
        raise EvidenceError(*faults)
    content = Attestation(
        number=0,
        repeats=policy.repeat,
        bag=bag_name(bag),
        identity={name: custom[name] for name in IDENTITY if name in custom},
        procedure=procedure.identity if procedure else None,
        procedure_signer=signer,
        documents=tuple(documents),
        notes=tuple(found),
        signed_at=own.signed_at,
    )
    hashes = {path.name: sha256(mapped(path)) for path in _files(bag)}
    return hashes | {name: sha256(data) for name, data in documents.items()}, content


def _files(bag: Path) -> list[Path]:
    """What of a folder is the bag: what a reader uses, the manifest and its signature."""
    names = (MANIFEST_NAME, signature.signature_path(Path(MANIFEST_NAME)).name)
    return [path for path in bag.iterdir() if is_read(path.name) or path.name in names]


def _recorded(bag: Path, manifest: Manifest | None, reader: BagReader) -> Iterator[Finding]:
    """Whether the files are what the recorder wrote."""
    if manifest is None:
        yield finding(Code.NO_MANIFEST, MANIFEST_NAME)
    else:
        yield from check_files(bag, manifest)
        late = [entry.name for entry in manifest.files if entry.hashed == "afterwards"]
        yield from (finding(Code.HASHED_AFTERWARDS, name) for name in late)
    if source := reader.metadata.custom_data.get("recovered_from"):
        yield finding(Code.RECOVERED, METADATA_NAME, source=source)
    if manifest is None or not manifest.clock.synchronized:
        yield finding(Unchecked.CLOCK_UNKNOWN, MANIFEST_NAME)
    for problem in reader.problems:
        yield finding(Unchecked.BAG_DAMAGED, bag.name, problem=problem)


def _check_signers(
    bag: Path,
    manifest: Manifest | None,
    procedure: object | None,
    signers: dict[Purpose, Signer],
    policy: Policy,
    later: Sequence[Signer] = (),
    now: datetime | None = None,
) -> list[Finding]:
    """Whether all signatures count, also those by a key that was revoked since, and were made in order.

    Adds the signer of the manifest. ``later`` signed attestations that follow this one.
    """
    found, at = list[Finding](), dict[Purpose, datetime]()
    path, attester = bag / MANIFEST_NAME, signers[Purpose.ATTESTATION]
    if by := tried(found, bag, lambda: signature.signer_of(path, Purpose.MANIFEST, None)):
        signers[Purpose.MANIFEST] = by
    else:
        found.append(finding(Code.MANIFEST_UNSIGNED, Purpose.MANIFEST))
    if Purpose.PROCEDURE not in signers:
        code = Code.PROCEDURE_UNSIGNED if procedure else Code.PROCEDURE_ABSENT
        found.append(finding(code, Purpose.PROCEDURE))
    revoked = {signature.fingerprint(key.key) for key in policy.trusted if key.revoked}
    for purpose, signer in signers.items():
        others = [other.signed_at for other in (attester, *later) if other.key != signer.key]
        shown_at = min(others, default=None)
        check = partial(signature.check_trust, signer, purpose, policy.trusted, purpose, shown_at)
        if by := tried(found, bag, check):
            signers[purpose], at[purpose] = by, by.signed_at
            if by.key in revoked and not others:
                found.append(finding(Unchecked.REVOCATION_BY_OWN_CLOCK, purpose, **dict(by)))
    begin, end = weld_times(manifest) if manifest else (None, None)
    times = {
        "procedure signed": at.get(Purpose.PROCEDURE),
        "begin of the weld": begin,
        "end of the weld": end,
        "manifest signed": at.get(Purpose.MANIFEST),
        "attested": at.get(Purpose.ATTESTATION),
        "this verification": now,
    }
    return found + order_findings(ATTESTATION_NAME, times)


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
    """Whether a bag is what was recorded and signed, has its place in the ``chain``, and with it its documents."""
    policy = replace(policy, afterwards=True)  # whether it was allowed, the attestation says
    found: list[Finding] = []
    path, signers, made = bag / ATTESTATION_NAME, dict[Purpose, Signer](), None
    signed = tried(found, bag, lambda: opened(path, read_file(path), policy.trusted))
    if signed is None:
        found.append(finding(Unchecked.FILES_NOT_CHECKED, bag))
    else:
        made, signers[Purpose.ATTESTATION] = signed.content, signed.signer
        if made.procedure_signer:
            signers[Purpose.PROCEDURE] = made.procedure_signer
        entries = chain.entries if chain else ()
        later = [entry.signer for entry in entries if entry.content.number > made.number]
        manifest = tried(found, bag, lambda: read_manifest(bag))
        found += _check_signers(bag, manifest, made.procedure, signers, policy, later, now)
        for name in signed.sha256:
            check = partial(_check_file, bag, name, signed, manifest)
            found += tried(found, bag / name, check) or []
        others = [path for path in _files(bag) if path.name not in signed.sha256]
        found += [finding(Code.NOT_ATTESTED, path) for path in others]
        found += [note for note in made.notes if note not in found]
        if made.documents:
            found.append(finding(Unchecked.NOT_JUDGED_AGAIN, bag))
        if chain is None:
            found.append(finding(Unchecked.NO_CHAIN, ATTESTATION_NAME))
        elif signed.data not in {entry.data for entry in entries}:
            found.append(finding(Code.NOT_IN_CHAIN, chain.folder, number=made.number))
        if not any(key.valid_from or key.valid_until or key.revoked for key in policy.trusted):
            found.append(finding(Unchecked.ALL_KEYS, ATTESTATION_NAME))
    faults = tuple(filter(policy.is_fault, found))
    rest = tuple(entry for entry in found if entry not in faults)
    return Verification(bag=bag, attested=made, signers=signers, findings=faults, not_checked=rest)


def _check_file(bag: Path, name: str, signed: Signed, manifest: Manifest | None) -> list[Finding]:
    """What of an attested file is not as it was: of one of the bag to the chunk, of a page also its record."""
    path, digest, is_document = bag / name, signed.sha256[name], name in signed.content.documents
    if not path.is_file():
        return [finding(Unchecked.DOCUMENT_ABSENT if is_document else Code.MISSING, name)]
    data = mapped(path)
    if sha256(data) != digest:
        # the manifest locates the change, if it is about the file that was attested
        listed = [entry for entry in manifest.files if entry.name == name] if manifest else []
        if listed and listed[0].sha256 == digest:
            return check_file(path, listed[0])
        return [finding(Code.CHANGED_SINCE, name)]
    made_of = json_sha256(bytes(data)) if is_document else None
    is_linked = made_of is None or made_of in signed.sha256.values()
    return [] if is_linked else [finding(Code.OTHER_RECORD, name)]
