"""Signed statements about recorded welds, each with the hash of the one before it: a chain over welds.

``attestation.json`` in the folder of a bag, beside the recorder's ``manifest.json``, says which manifest, files,
procedure and software belong together; ``attestation.json.sig`` is its signature. The folder of the chain has a copy of
each by its number, so that a weld that is removed later leaves a hole.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fsw_quality import signature
from fsw_quality.procedure import Identity
from fsw_quality.signature import LibraryMissingError, PublicKey
from fsw_recorder.bag_metadata import METADATA_NAME, read_metadata
from fsw_recorder.bag_reader import SUFFIXES, BagReader
from fsw_recorder.clock_source import UNKNOWN
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import MANIFEST_NAME, Manifest, mapped, read_manifest, sha256
from fsw_recorder.manifest_check import Finding, check_files, complete
from fsw_schema.files import locked, read_regular, write_whole
from fsw_schema.models import InputError, Many, Model, json_content_of, validate

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

ATTESTATION_NAME = "attestation.json"
#: custom data of the bag that says what was welded with what: ``recorder`` parameter ``custom_data``
IDENTITY = ("canister", "lid", "tool", "machine")
_MOST_FINDINGS = 5


class Attestation(Model):
    """Content of attestation.json."""

    format: Literal["fsw_weld_attestation"] = "fsw_weld_attestation"
    version: Literal[1] = 1
    number: int
    """place in the chain, from 1"""
    previous_sha256: str | None = None
    """of the attestation before it; the first has none"""
    bag: str
    """name of the folder, of one called ``bag`` with that of its parent"""
    identity: dict[str, str]
    """canister, lid, tool and machine, as far as the recorder was told"""
    manifest_sha256: str
    """of manifest.json"""
    files_sha256: dict[str, str]
    """of the files of the bag"""
    attachments_sha256: dict[str, str]
    """of the files inside the bag: scenario, software versions, parameters of every node"""
    procedure: Identity | None = None
    software: dict[str, str]
    documents_sha256: dict[str, str]
    """of files that were attested together with the bag, e.g. the record of the weld"""
    notes: Many[str]
    """what was not as it should be when it was attested"""
    attested_at: str
    """by the clock of the machine that signed"""

    def text(self) -> str:
        """As it is written and signed."""
        return self.model_dump_json(indent=1, exclude_none=True) + "\n"


@dataclass(frozen=True, slots=True)
class Signed:
    """An attestation as it was found."""

    path: Path
    data: bytes
    content: Attestation
    signer: PublicKey

    @property
    def sha256(self) -> str:
        """What the next one of the chain names it by."""
        return sha256(self.data)


def read_signed(path: Path, trusted: Sequence[PublicKey] | None) -> Signed:
    """An attestation with its signature, checked; without ``trusted`` keys, any will do.

    Raises
    ------
    InputError
        One of the two is missing or damaged, or the signature is not one of a trusted key.
    """
    signature_path = signature.signature_path(path)
    try:
        data, armoured = read_regular(path), read_regular(signature_path).decode("ascii", errors="replace")
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}") from None
    try:
        signer = signature.verify(data, armoured, trusted)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return Signed(path, data, validate(Attestation, json_content_of(data.decode(), str(path)), str(path)), signer)


@dataclass(frozen=True, slots=True)
class Chain:
    """The attestations of a folder, in order, and what is wrong with them."""

    folder: Path
    entries: tuple[Signed, ...] = ()
    problems: tuple[str, ...] = ()

    def of(self, files_sha256: Mapping[str, str]) -> Signed | None:
        """The entry that has one of these MCAP or sqlite3 files."""
        wanted = _data_files(files_sha256)
        return next((one for one in self.entries if wanted & _data_files(one.content.files_sha256)), None)


def read_chain(folder: Path, trusted: Sequence[PublicKey]) -> Chain:
    """All attestations of a chain: their signatures, their order, whether one is missing or was exchanged.

    A chain that was cut off at its end is intact in itself: compare its last number and hash with what was noted.
    """
    names = sorted(path for path in folder.glob("*.json") if path.stem.isdecimal()) if folder.is_dir() else []
    entries, problems = [], []
    seen: dict[str, int] = {}
    before: Signed | None = None
    expected, unusable, since = 1, "", 0
    for path in names:
        number = int(path.stem)
        if number != expected:
            gap = f"weld {expected} is" if number == expected + 1 else f"welds {expected} to {number - 1} are"
            problems.append(f"{folder}: {gap} missing")
            before = None
        try:
            one = read_signed(path, trusted)
        except InputError as error:
            text = str(error).removeprefix(f"{path}: ")
            if text == unusable and number == expected:  # by a wrong key all are signed: one line, not one for each
                problems[-1] = f"{folder}: weld {since} and those after it, to {number}: {text}"
            else:
                problems.append(str(error))
                unusable, since = text, number
            before, expected = None, number + 1
            continue
        unusable = ""
        if one.content.number != number:
            problems.append(f"{path}: is the attestation of weld {one.content.number}, not of weld {number}")
        if before is not None and one.content.previous_sha256 != before.sha256:
            problems.append(f"{path}: does not follow {before.path.name}, which was exchanged after it")
        for name in _data_files(one.content.files_sha256):
            if (first := seen.setdefault(name, number)) != number:
                problems.append(f"{path}: is a second attestation of the weld of number {first}")
                break
        entries.append(one)
        before, expected = one, number + 1
    return Chain(folder, tuple(entries), tuple(problems))


def _data_files(files_sha256: Mapping[str, str]) -> set[str]:
    return {value for name, value in files_sha256.items() if name != METADATA_NAME}


def attest(
    bag: Path,
    chain_folder: Path,
    key: Ed25519PrivateKey,
    now: datetime,
    procedure: Identity | None = None,
    documents: Sequence[Path] = (),
) -> Attestation:
    """Sign for a bag and add it to a chain. After a crash in between, the same call ends what was begun.

    What the bag's manifest lacks is hashed now, and noted. The chain's folder is made when there is none. The hashes of
    the ``documents`` are signed, too.

    Raises
    ------
    BagError
        There is no bag, it is not what was recorded, or it is in the chain already.
    InputError
        The chain is damaged, or two documents have one name.
    """
    hashes = _hashes(documents)
    manifest, text, notes = manifest_for(bag)
    if found := check_files(bag, manifest):
        raise BagError(f"{bag}: cannot be attested: {summary(found)}")
    files = {one.name: one.sha256 for one in manifest.files}
    with BagReader(bag) as reader:
        software = software_versions({one.name: one.data for one in reader.attachments()})
    with locked(chain_folder):
        chain = read_chain(chain_folder, [PublicKey(key.public_key().public_bytes_raw())])
        if chain.problems:
            raise InputError(f"the chain cannot be continued: {chain.problems[0]}")
        if (entry := chain.of(files)) is not None:
            return _end(bag, text, files, entry)
        last = chain.entries[-1] if chain.entries else None
        made = Attestation(
            number=last.content.number + 1 if last else 1,
            previous_sha256=last.sha256 if last else None,
            bag=bag_name(bag),
            identity={name: manifest.custom_data[name] for name in IDENTITY if name in manifest.custom_data},
            manifest_sha256=sha256(text.encode()),
            files_sha256=files,
            attachments_sha256=manifest.attachments_sha256,
            procedure=procedure,
            software=software,
            documents_sha256=hashes,
            notes=tuple(notes),
            attested_at=now.isoformat(timespec="seconds"),
        )
        _write(bag, chain_folder / f"{made.number:06d}.json", text, made.text(), key)
    return made


def _hashes(documents: Sequence[Path]) -> dict[str, str]:
    """Hashes of files by name; InputError when two have the same."""
    names = [path.name for path in documents]
    if doubled := next((one for one in names if names.count(one) > 1), None):
        raise InputError(f"two of the files to attest have the name {doubled}, by which they are listed; rename one")
    return {path.name: sha256(mapped(path)) for path in documents}


def _write(bag: Path, entry: Path, manifest_text: str, text: str, key: Ed25519PrivateKey) -> None:
    """Write manifest, attestation and signature; the signature first: an attestation without one is never seen."""
    signed = signature.sign(text.encode(), key)
    write_whole(bag / MANIFEST_NAME, manifest_text, durable=True)
    write_whole(signature.signature_path(entry), signed, durable=True)
    write_whole(entry, text, durable=True)
    write_whole(bag / ATTESTATION_NAME, text, durable=True)
    write_whole(signature.signature_path(bag / ATTESTATION_NAME), signed, durable=True)


def _end(bag: Path, manifest_text: str, files_sha256: Mapping[str, str], entry: Signed) -> Attestation:
    """Put into a bag what is in the chain already; BagError where that has been done, or was for other files."""
    if signature.signature_path(bag / ATTESTATION_NAME).exists() or entry.content.files_sha256 != files_sha256:
        place = f"{entry.path.parent} already, as weld {entry.content.number} ({entry.content.bag})"
        raise BagError(f"{bag}: is in {place}")
    if entry.content.manifest_sha256 != sha256(manifest_text.encode()):
        raise BagError(f"{bag}: {MANIFEST_NAME} is not that of weld {entry.content.number} of the chain")
    write_whole(bag / MANIFEST_NAME, manifest_text, durable=True)
    write_whole(bag / ATTESTATION_NAME, entry.data.decode(), durable=True)
    armoured = read_regular(signature.signature_path(entry.path)).decode("ascii")
    write_whole(signature.signature_path(bag / ATTESTATION_NAME), armoured, durable=True)
    return entry.content


def manifest_for(bag: Path) -> tuple[Manifest, str, list[str]]:
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
        if manifest is None:
            notes.append(f"no {MANIFEST_NAME}: the recorder was killed before it wrote one, or wrote none")
            attachments = {one.name: sha256(one.data) for one in reader.attachments()}
            custom = reader.metadata.custom_data
            manifest = Manifest(
                bag=bag.resolve().name, custom_data=custom, attachments_sha256=attachments, clock=UNKNOWN, files=()
            )
        notes += [f"{problem}" for problem in reader.problems]
    whole, more = complete(bag, manifest)
    text = whole.text() if more or not manifest.files else (bag / MANIFEST_NAME).read_text(encoding="utf-8")
    return whole, text, [*notes, *more]


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


def summary(found: Sequence[Finding]) -> str:
    """Findings in one line."""
    lines = [one.line for one in found[:_MOST_FINDINGS]]
    return "; ".join(lines + [f"and {len(found) - _MOST_FINDINGS} more"] * (len(found) > _MOST_FINDINGS))


def statement(bag: Path) -> tuple[list[str], list[str]]:
    """Whether a bag is what was recorded, and who signed for it, in words; and what of that is wrong.

    Any key will do: whose it is, the reader of its fingerprint has to say.
    """
    try:
        manifest = read_manifest(bag) if bag.is_dir() else None
        found = check_files(bag, manifest) if manifest else []
    except BagError as error:
        return [str(error)], [str(error)]
    if manifest is None:
        return [f"no {MANIFEST_NAME}: whether the files are what was recorded is not known"], []
    if found:
        text = f"not as {MANIFEST_NAME} has it: {summary(found)}"
        return [text], [text]
    late = ", hashed after the recording" if any(one.hashed == "afterwards" for one in manifest.files) else ""
    told = [f"{len(manifest.files)} files as {MANIFEST_NAME} has them{late}"]
    if not (bag / ATTESTATION_NAME).exists():
        return [*told, "not attested when this was written"], []
    try:
        signed = read_signed(bag / ATTESTATION_NAME, None)
    except LibraryMissingError as error:
        return [*told, f"the attestation cannot be checked: {error}"], []
    except InputError as error:
        return [*told, str(error)], [str(error)]
    if wrong := [*_other_identity(bag, signed.content), *_manifest_findings(bag, signed.content)]:
        text = f"not as it was attested: {summary(wrong)}"
        return [*told, text], [text]
    when, number = signed.content.attested_at, signed.content.number
    return [*told, f"attested as weld {number} at {when}, signed by key {signed.signer.fingerprint}"], []


def verify_bag(
    bag: Path, trusted: Sequence[PublicKey], chain: Chain | None = None, documents: Sequence[Path] = ()
) -> tuple[Attestation | None, list[Finding]]:
    """Whether a bag is what was recorded and signed, has its place in the ``chain``, and with it the ``documents``.

    Returns what was signed, None when it is not there or cannot be trusted, and what is wrong; nothing: it is proven.
    """
    if not bag.is_dir():
        return None, [Finding(str(bag), "is not the folder of a bag")]
    try:
        signed = read_signed(bag / ATTESTATION_NAME, trusted)
    except InputError as error:
        return None, [Finding(ATTESTATION_NAME, str(error).removeprefix(f"{bag / ATTESTATION_NAME}: "))]
    attested, found = signed.content, []
    listed = [name for name in attested.files_sha256 if name != METADATA_NAME]
    others = any(path.name.endswith(SUFFIXES) and path.name not in listed for path in bag.iterdir())
    if others and not any((bag / name).exists() for name in listed):
        of = ", ".join([f"bag {attested.bag}", *(f"{key} {value}" for key, value in attested.identity.items())])
        return attested, [Finding(ATTESTATION_NAME, f"belongs to another weld ({of}): none of its files is here")]
    found += _other_identity(bag, attested)
    found += _manifest_findings(bag, attested)
    for path in documents:
        if path.name not in attested.documents_sha256:
            found.append(Finding(str(path), f"was not attested with weld {attested.number}"))
        elif sha256(mapped(path)) != attested.documents_sha256[path.name]:
            found.append(Finding(str(path), f"is not the file that was attested with weld {attested.number}"))
    if chain is not None:
        here = next((one for one in chain.entries if one.content.number == attested.number), None)
        if here is None:
            found.append(Finding(str(chain.folder), f"weld {attested.number}, which this bag is, is not in the chain"))
        elif here.data != signed.data:
            found.append(Finding(str(here.path), f"is another weld than this bag ({here.content.bag})"))
    return attested, found


def _other_identity(bag: Path, attested: Attestation) -> list[Finding]:
    try:
        custom = read_metadata(bag).custom_data
    except BagError:
        return []
    return [
        Finding(ATTESTATION_NAME, f"has {name} {value}, metadata.yaml has {custom.get(name, 'none')}")
        for name, value in attested.identity.items()
        if custom.get(name) != value
    ]


def _manifest_findings(bag: Path, attested: Attestation) -> list[Finding]:
    """The files of the bag against the manifest that was signed; without that, against their hashes alone."""
    path = bag / MANIFEST_NAME
    try:
        data = read_regular(path)
        manifest = read_manifest(bag) if sha256(data) == attested.manifest_sha256 else None
        text = "is not the manifest that was signed"
    except OSError as error:
        manifest, text = None, str(error.strerror)
    if manifest is not None:
        return check_files(bag, manifest)
    found = [Finding(MANIFEST_NAME, f"{text}; so files are compared as a whole")]
    for name, wanted in attested.files_sha256.items():
        try:
            same = sha256(mapped(bag / name)) == wanted
        except OSError as error:
            found.append(Finding(name, str(error.strerror)))
            continue
        if not same:
            found.append(Finding(name, "is not what was recorded"))
    return found
