"""Attests bags and verifies what was attested; nothing is signed that does not fit together."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from fsw_analysis.procedure import Procedure, attached
from fsw_control.schema.files import locked, write_whole
from fsw_control.schema.models import InputError, Many, Model
from fsw_quality import attestation
from fsw_quality.attestation import Attestation, Chain, Signed
from fsw_quality.cross_check import check_links, check_records, is_record
from fsw_quality.record_content import bag_name
from fsw_quality.report import json_sha256
from fsw_recorder import signature
from fsw_recorder.bag_metadata import ATTESTATION_NAME, IDENTITY, METADATA_NAME
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, EvidenceError, Finding, finding
from fsw_recorder.manifest import MANIFEST_NAME, Manifest, mapped, read_manifest, sha256
from fsw_recorder.manifest_check import check_file, check_files, is_read
from fsw_recorder.signature import Purpose, Signer, TrustedKey

if TYPE_CHECKING:  # from the extra signing
    from securesystemslib.signer import CryptoSigner

T = TypeVar("T")
#: what is noted as not checked; anything else is wrong
_NOTED = {
    Code.BAG_DAMAGED,
    Code.CLOCK_UNKNOWN,
    Code.PROCEDURE_NOT_RECORDED,
    Code.DOCUMENT_FOREIGN,
    Code.DOCUMENT_ABSENT,
    Code.NOT_COMPARED,
    Code.NOT_JUDGED_AGAIN,
    Code.REVOCATION_BY_OWN_CLOCK,
    Code.NO_CHAIN,
    Code.ALL_KEYS,
    Code.FILES_NOT_CHECKED,
}
#: the same where the recorder need not answer for all of the bag
_AFTERWARDS = {Code.NO_MANIFEST, Code.UNLISTED, Code.HASHED_AFTERWARDS, Code.RECOVERED}
#: the same unless signatures are required
_UNSIGNED = {
    Purpose.MANIFEST: Code.MANIFEST_UNSIGNED,
    Purpose.PROCEDURE: Code.PROCEDURE_UNSIGNED,
}


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

    @property
    def noted(self) -> set[Code]:
        """What does not refuse a bag."""
        more = _AFTERWARDS if self.afterwards else set()
        unsigned = {*_UNSIGNED.values(), Code.PROCEDURE_ABSENT}
        return _NOTED | more | (set() if self.require_signed else unsigned)


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
    """Sign for a bag and add it to a chain. After a crash in between, the same call ends what was begun.

    The chain's folder is made when there is none.

    Raises
    ------
    EvidenceError
        Something does not fit together, or with the policy; its findings say what.
    BagError
        There is no bag, or it cannot be read.
    """
    public = signature.fingerprint(key.public_key.keyid)
    own = Signer(key=public, signed_at=now.replace(microsecond=0))
    signature.check_trust(own, Purpose.ATTESTATION, policy.trusted, ATTESTATION_NAME)
    hashes, draft = _draft(subject, own, policy, progress)
    copy = subject.bag / ATTESTATION_NAME
    with locked(chain_folder):
        chain = attestation.read_chain(chain_folder, policy.trusted)
        # The chain is written first, the bag's copy last: a bag that is in the chain, but has no
        # copy, was left so by a crash.
        entry = next((entry for entry in chain.entries if entry.sha256 == hashes), None)
        if entry is None or copy.exists():
            number = len(chain.entries) + 1
            made = draft.changed(number=number, previous_sha256=chain.last_sha256)
            stated = made.model_dump(mode="json", exclude_none=True)
            data = signature.envelope(hashes, Purpose.ATTESTATION, stated, key).encode()
            path = chain_folder / f"{number:06d}.json"
            entry = attestation.opened(path, data, policy.trusted, chain.last_sha256)
            entries = [*chain.entries, entry]
            if wrong := chain.findings or tuple(attestation.chain_findings(entries)):
                raise EvidenceError(*wrong)
            if path.exists():  # renamed by someone: it is another one's
                raise EvidenceError(finding(Code.BROKEN_LINK, path.name, number=number))
            write_whole(path, data, durable=True)
        write_whole(copy, entry.data, durable=True)
    return entry.content


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
        code = Code.OTHER_PROCEDURE if ran_by else Code.PROCEDURE_NOT_RECORDED
        found.append(finding(code, METADATA_NAME, **dict(procedure.identity)))
    signers = {Purpose.ATTESTATION: own} | ({Purpose.PROCEDURE: signer} if signer else {})
    found += _check_signers(bag, manifest, procedure, signers, policy)
    if {entry.code for entry in found} <= policy.noted:  # else no document can be compared
        found += check_records(bag, procedure, documents, progress)
        records = [sha256(data) for name, data in documents.items() if is_record(name, data)]
        found += check_links(documents, records)
    if refused := [entry for entry in found if entry.code not in policy.noted]:
        raise EvidenceError(*refused)
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
        yield finding(Code.CLOCK_UNKNOWN, MANIFEST_NAME)
    for problem in reader.problems:
        yield finding(Code.BAG_DAMAGED, bag.name, problem=problem)


def _check_signers(
    bag: Path,
    manifest: Manifest | None,
    procedure: object | None,
    signers: dict[Purpose, Signer],
    policy: Policy,
    later: Sequence[Signer] = (),
    now: datetime | None = None,
) -> list[Finding]:
    """Whether all signatures count, were made in order, and not by a key that was revoked since.

    Adds the signer of the manifest. ``later`` signed attestations that follow this one.
    """
    found: list[Finding] = []
    path, attester, keys = bag / MANIFEST_NAME, signers[Purpose.ATTESTATION], policy.trusted
    if by := _tried(found, bag, lambda: signature.signer_of(path, Purpose.MANIFEST, keys)):
        signers[Purpose.MANIFEST] = by
    if by := signers.get(Purpose.PROCEDURE):
        _tried(found, bag, lambda: signature.check_trust(by, Purpose.PROCEDURE, keys, "procedure"))
    unsigned = _UNSIGNED | ({} if procedure else {Purpose.PROCEDURE: Code.PROCEDURE_ABSENT})
    found += [finding(unsigned[key], key) for key in unsigned if key not in signers]
    for purpose, signer in signers.items():
        shown_at = [other.signed_at for other in (attester, *later) if other.key != signer.key]
        revoked = signature.check_revocation(signer, shown_at, keys, purpose)
        found += [revoked] if revoked else []
    at = {purpose: signer.signed_at for purpose, signer in signers.items()}
    begin, end = attestation.weld_times(manifest) if manifest else (None, None)
    times = {
        "procedure signed": at.get(Purpose.PROCEDURE),
        "begin of the weld": begin,
        "end of the weld": end,
        "manifest signed": at.get(Purpose.MANIFEST),
        "attested": attester.signed_at,
        "this verification": now,
    }
    return found + attestation.order_findings(ATTESTATION_NAME, times)


class Verification(Model):
    """Result for a bag: what was attested, by whom, what is wrong, and what was not checked."""

    bag: Path
    attested: Attestation | None = None
    signers: dict[Purpose, Signer]
    findings: Many[Finding]
    not_checked: Many[Finding]


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
    found: list[Finding] = []
    path, signers, made = bag / ATTESTATION_NAME, dict[Purpose, Signer](), None
    signed = _tried(found, bag, lambda: attestation.read_signed(path, policy.trusted))
    if signed is None:
        found.append(finding(Code.FILES_NOT_CHECKED, bag))
    else:
        made, signers[Purpose.ATTESTATION] = signed.content, signed.signer
        if made.procedure_signer:
            signers[Purpose.PROCEDURE] = made.procedure_signer
        entries = chain.entries if chain else ()
        later = [entry.signer for entry in entries if entry.content.number > made.number]
        manifest = _tried(found, bag, lambda: read_manifest(bag))
        found += _check_signers(bag, manifest, made.procedure, signers, policy, later, now)
        found += _check_files(bag, signed, manifest, documents)
        found += [note for note in made.notes if note not in found]
        if chain is None:
            found.append(finding(Code.NO_CHAIN, ATTESTATION_NAME))
        elif signed.data not in {entry.data for entry in entries}:
            found.append(finding(Code.NOT_IN_CHAIN, chain.folder, number=made.number))
        if not any(key.valid_from or key.valid_until or key.revoked for key in policy.trusted):
            found.append(finding(Code.ALL_KEYS, ATTESTATION_NAME))
    noted = policy.noted | _AFTERWARDS
    wrong = tuple(entry for entry in found if entry.code not in noted)
    rest = tuple(entry for entry in found if entry.code in noted)
    return Verification(bag=bag, attested=made, signers=signers, findings=wrong, not_checked=rest)


def _check_files(
    bag: Path, signed: Signed, manifest: Manifest | None, documents: Sequence[Path]
) -> list[Finding]:
    """Every file that was attested, as far as it is here: those of the bag to the chunk, documents with their record."""
    found: list[Finding] = []
    names = signed.content.documents
    listed = {entry.name: entry for entry in manifest.files} if manifest else {}
    given = {sha256(mapped(path)): path for path in documents}
    contents: dict[str, bytes] = {}
    for name, digest in signed.sha256.items():
        path = given.get(digest, bag / name)
        if not path.is_file():
            found.append(finding(Code.DOCUMENT_ABSENT if name in names else Code.MISSING, name))
        elif (data := _tried(found, path, partial(mapped, path))) is None:
            pass  # it cannot be read, which is a finding
        elif sha256(data) != digest:
            # the manifest locates the change, if it is about the file that was attested
            is_listed = name in listed and listed[name].sha256 == digest
            changed = finding(Code.CHANGED_SINCE, name)
            found += check_file(path, listed[name]) if is_listed else [changed]
        elif name in names:
            contents[name] = bytes(data)
    foreign = [path for digest, path in given.items() if digest not in signed.sha256.values()]
    foreign += [path for path in _files(bag) if path.name not in signed.sha256]
    found += [finding(Code.NOT_ATTESTED, path) for path in foreign]
    found += check_links(contents, signed.sha256.values())
    compared = [
        name for name, data in contents.items() if is_record(name, data) or json_sha256(data)
    ]
    return found + [finding(Code.NOT_JUDGED_AGAIN, name) for name in compared]


def _tried(found: list[Finding], bag: Path, check: Callable[[], T]) -> T | None:
    """Result of a check; None where it fails, which is among the findings then."""
    try:
        return check()
    except (BagError, InputError, OSError) as error:
        found += getattr(error, "findings", [finding(Code.UNREADABLE, bag, reason=error)])
        return None
