"""Signed statements in a standard envelope, keys, and lists of trusted keys.

A statement is an in-toto Statement (https://in-toto.io/Statement/v1) in a DSSE envelope
(https://github.com/secure-systems-lab/dsse), created and verified by securesystemslib: hashes of
files (``subject``), the :class:`Purpose`, and a statement about them (``predicate``). The
signature of ``FILE`` is a statement in ``FILE.sig``. Keys have OpenSSH's format.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Sequence
from datetime import UTC, date, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Generic, Literal, NamedTuple, TypeVar

from pydantic import AfterValidator, AwareDatetime, Field, Strict

from fsw_control.schema.extensions import Extra
from fsw_control.schema.files import read_private, read_regular
from fsw_control.schema.models import InputError, Many, Model, content_of, read_text, validate
from fsw_recorder.findings import Code, EvidenceError, finding

if TYPE_CHECKING:  # from the extra signing
    from securesystemslib.signer import CryptoSigner, SSlibKey

SUFFIX = ".sig"
_Day = Annotated[date, Strict(False)]
_EXTRA = Extra("fsw-control", "signing", ("cryptography", "securesystemslib"))
PAYLOAD_TYPE = "application/vnd.in-toto+json"
#: before the purpose: type of a statement's predicate, with its version
PREDICATE_TYPE = "urn:fsw-control:v3:"


class Purpose(StrEnum):
    """Purpose of a signature."""

    MANIFEST = "manifest"
    ATTESTATION = "attestation"
    PROCEDURE = "procedure"


class TrustedKey(Model):
    """A key whose signatures count, with its purposes and validity."""

    name: str
    """of its owner, e.g. the machine"""
    key: Annotated[str, AfterValidator(lambda line: _library_key(line) and line)]
    """a line ``ssh-ed25519 AAAA...``"""
    purposes: Many[Annotated[Purpose, Strict(False)]] = tuple(Purpose)
    """left out: all"""
    valid_from: _Day | None = None
    """first day"""
    valid_until: _Day | None = None
    """last day"""
    revoked: _Day | None = None
    """day from which its signatures do not count, because others may have had the key"""


class KeyList(Model):
    """Content of a list of trusted keys."""

    format: Literal["fsw_trusted_keys"] = "fsw_trusted_keys"
    version: Literal[1] = 1
    keys: Annotated[Many[TrustedKey], Field(min_length=1)]


class Stated(Model):
    """Statement about files: the predicate of their signature."""

    signed_at: Annotated[AwareDatetime, Strict(False)]
    """by the clock of the computer that signed"""


class Signer(Stated):
    """Signer of a file, and the time."""

    name: str = ""
    """name in the list of trusted keys"""
    key: str
    """fingerprint as in ``ssh-keygen -l``"""

    @property
    def words(self) -> str:
        """Text for people."""
        owner = f"{self.name} (key {self.key})" if self.name else f"key {self.key}"
        return f"{owner} at {self.signed_at.isoformat(timespec='seconds')}"


S = TypeVar("S", bound=Stated)


class Statement(NamedTuple, Generic[S]):
    """A verified statement: its file, hashes of files by name, the predicate, and the signer."""

    data: bytes
    sha256: dict[str, str]
    predicate: S
    signer: Signer


def default_key() -> Path:
    """Default path of the key, in the user's configuration, outside any repository."""
    configured = Path(os.environ.get("XDG_CONFIG_HOME", ""))
    folder = configured if configured.is_absolute() else Path.home() / ".config"
    return folder / "fsw-control" / "evidence_key"


def public_path(path: Path) -> Path:
    """Path of the public key that belongs to a private one."""
    return path.with_name(f"{path.name}.pub")


def signature_path(path: Path) -> Path:
    """Path of a file's signature."""
    return path.with_name(path.name + SUFFIX)


def load_private(path: Path) -> CryptoSigner:
    """Load a signing key; its key id is the public key as OpenSSH writes it.

    Raises
    ------
    InputError
        If it is missing, readable by others, or not an unencrypted key of OpenSSH.
    """
    _EXTRA.need("signatures")
    from cryptography.hazmat.primitives import serialization as ssh
    from securesystemslib.signer import CryptoSigner

    if not path.exists():
        make = f"mkdir -p {path.parent} && ssh-keygen -t ed25519 -N '' -f {path}"
        raise InputError(f"key {path} does not exist; make it with {make}")
    try:
        key = ssh.load_ssh_private_key(read_private("key", path), password=None)
        form = ssh.Encoding.OpenSSH, ssh.PublicFormat.OpenSSH
        return CryptoSigner(key, _library_key(key.public_key().public_bytes(*form).decode()))
    except Exception as error:  # cryptography raises various kinds
        text = " ".join(str(error).split())[:150]
        raise InputError(f"key {path}: cannot be used: {text}") from None


def load_trusted(paths: Sequence[Path]) -> tuple[TrustedKey, ...]:
    """Load trusted keys: public keys, and YAML lists of keys.

    A public key is named by its file, and valid for everything and for ever.

    Raises
    ------
    InputError
        If a file cannot be read or is invalid.
    """
    keys: list[TrustedKey] = []
    for path in paths:
        text = read_text(path, "trusted key")
        alone = {"keys": [{"name": path.stem, "key": text}]}
        content = alone if text.startswith("ssh-") else content_of(text, str(path))
        keys += validate(KeyList, content, str(path)).keys
    return tuple(keys)


def fingerprint(line: str) -> str:
    """Fingerprint of a public key, as in ``ssh-keygen -l``."""
    digest = hashlib.sha256(base64.b64decode(line.split()[1])).digest()
    return "SHA256:" + base64.b64encode(digest).decode().rstrip("=")


def envelope(
    sha256: dict[str, str], purpose: Purpose, predicate: Stated, key: CryptoSigner
) -> str:
    """Sign a statement about files with these hashes; returns the text of the envelope."""
    from securesystemslib.dsse import Envelope

    statement = {
        "_type": "https://in-toto.io/Statement/v1",
        "subject": [{"name": name, "digest": {"sha256": sha256[name]}} for name in sha256],
        "predicateType": PREDICATE_TYPE + purpose,
        "predicate": predicate.model_dump(mode="json", exclude_none=True),
    }
    signed = Envelope(json.dumps(statement).encode(), PAYLOAD_TYPE, {})
    signed.sign(key)
    return json.dumps(signed.to_dict(), indent=1) + "\n"


def open_envelope(
    data: bytes,
    purpose: Purpose,
    model: type[S],
    trusted: Sequence[TrustedKey] | None,
    name: object,
) -> Statement[S]:
    """Verify the signed statement in file ``name``, whose predicate is a ``model``.

    Without ``trusted`` any key is accepted, e.g. to detect changes of a file.

    Raises
    ------
    EvidenceError
        If it is damaged, of another kind or purpose, or by a key that does not count for it.
    """
    _EXTRA.need("signatures")
    from securesystemslib.dsse import Envelope

    try:
        signed = Envelope.from_dict(json.loads(data))
        # The key id is the key itself, so the signature itself proves its owner:
        # the envelope is verified with the key that it names, and only then that key is trusted.
        (line,) = signed.signatures
        signed.verify([_library_key(line)], 1)
        content = json.loads(signed.payload)
        kind = (signed.payload_type, content["predicateType"])
        if kind != (PAYLOAD_TYPE, PREDICATE_TYPE + purpose):
            raise ValueError(kind)
        sha256 = {entry["name"]: entry["digest"]["sha256"] for entry in content["subject"]}
        predicate = model.model_validate(content["predicate"])
        signer = Signer(key=fingerprint(line), signed_at=predicate.signed_at)
    except Exception:  # of JSON, base64, pydantic, securesystemslib and cryptography
        raise EvidenceError(finding(Code.SIGNATURE_DAMAGED, name)) from None
    signer = signer if trusted is None else check_trust(signer, purpose, trusted, name)
    return Statement(data, sha256, predicate, signer)


def sign(data: bytes, name: str, purpose: Purpose, key: CryptoSigner, now: datetime) -> str:
    """Sign the content of a file; returns the text of the signature file."""
    hashes = {name: hashlib.sha256(data).hexdigest()}
    return envelope(hashes, purpose, Stated(signed_at=now.astimezone(UTC)), key)


def signer_of(
    path: Path, purpose: Purpose, trusted: Sequence[TrustedKey] | None, required: bool = False
) -> Signer | None:
    """Signer of a file, by the signature beside it; None if it is not signed.

    Without ``trusted`` keys any key is accepted, unless a signature is ``required``.

    Raises
    ------
    EvidenceError
        As :func:`open_envelope`; if the file was changed after it was signed, or is not signed
        although ``required``.
    """
    if not signature_path(path).exists():
        if required:
            raise EvidenceError(finding(Code.NOT_SIGNED, path.name))
        return None
    keys = (trusted or ()) if required else trusted
    statement = open_envelope(read_file(signature_path(path)), purpose, Stated, keys, path.name)
    if hashlib.sha256(read_file(path)).hexdigest() not in statement.sha256.values():
        raise EvidenceError(finding(Code.CONTENT_CHANGED, path.name))
    return statement.signer


def read_file(path: Path) -> bytes:
    """Content of a file; EvidenceError if it cannot be read."""
    try:
        return read_regular(path)
    except OSError as error:
        code = Code.UNREADABLE if path.exists() else Code.MISSING
        raise EvidenceError(finding(code, path.name, reason=error.strerror)) from None


def check_trust(
    signer: Signer,
    purpose: Purpose,
    trusted: Sequence[TrustedKey],
    name: object,
    shown_at: datetime | None = None,
) -> Signer:
    """The signer with its owner's name; EvidenceError if the key is not valid for this use.

    A thief of the key can state any time. So a signature by a key that is revoked now must also
    have been ``shown_at`` a time before: when others signed first for something that contains it.
    """
    known = {fingerprint(entry.key): entry for entry in trusted}
    if signer.key not in known:
        listed = ", ".join(sorted(known)) or "none is given"
        raise EvidenceError(finding(Code.KEY_UNKNOWN, name, key=signer.key, trusted=listed))
    entry, times = known[signer.key], (signer.signed_at, shown_at or signer.signed_at)
    day, shown = (time.astimezone(UTC).date() for time in (times[0], max(times)))
    first, last, revoked = entry.valid_from, entry.valid_until, entry.revoked
    signer = signer.changed(name=entry.name)
    for code, limit, broken in (
        (Code.KEY_PURPOSE, purpose, purpose not in entry.purposes),
        (Code.KEY_EARLY, first, first is not None and day < first),
        (Code.KEY_EXPIRED, last, last is not None and day > last),
        (Code.KEY_REVOKED, revoked, revoked is not None and shown >= revoked),
    ):
        if broken:
            raise EvidenceError(finding(code, name, **dict(signer), limit=limit))
    return signer


def _library_key(line: str) -> SSlibKey:
    """Convert OpenSSH's public key for securesystemslib; ValueError if it is not one."""
    _EXTRA.need("signatures")
    from cryptography.hazmat.primitives.serialization import load_ssh_public_key
    from securesystemslib.signer import SSlibKey

    try:
        return SSlibKey.from_crypto(load_ssh_public_key(line.encode()), keyid=line)
    except Exception:  # cryptography raises various kinds
        raise ValueError(f"is {line[:20]!r}, not a line 'ssh-ed25519 AAAA...'") from None
