"""Ed25519 keys, lists of trusted keys, and signatures of files.

The signature of ``FILE`` is ``FILE.sig``: a DSSE envelope
(https://github.com/secure-systems-lab/dsse), created and verified by securesystemslib, around a
:class:`Statement` of what was signed, its purpose and time. Keys have OpenSSH's format.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AwareDatetime, Field, Strict

from fsw_control.schema.extensions import Extra, MissingExtraError
from fsw_control.schema.files import read_private, read_regular, write_whole
from fsw_control.schema.models import (
    InputError,
    Many,
    Model,
    content_of,
    json_content_of,
    validate,
)
from fsw_recorder.findings import Code, EvidenceError, Finding, finding

if TYPE_CHECKING:  # from the extra signing
    from securesystemslib.signer import CryptoSigner

SUFFIX = ".sig"
_EXTRA = Extra("fsw-control", "signing", ("cryptography", "securesystemslib"))
#: payload type of the envelopes; a signature made for another purpose does not count
PAYLOAD_TYPE = "application/vnd.fsw-control.statement.v1+json"


class Purpose(StrEnum):
    """Purpose of a signature."""

    MANIFEST = "manifest"
    ATTESTATION = "attestation"
    PROCEDURE = "procedure"


class Statement(Model):
    """Payload of the envelope: what a signature states."""

    purpose: Annotated[Purpose, Strict(False)]
    name: str
    """of the file"""
    sha256: str
    """of the file"""
    signed_at: Annotated[AwareDatetime, Strict(False)]
    """by the clock of the computer that signed"""
    key: str
    """public key of the signer, as OpenSSH writes it"""


class TrustedKey(Model):
    """A key whose signatures count, with its purposes and validity."""

    name: str
    """of its owner, e.g. the machine"""
    key: str
    """a line ``ssh-ed25519 AAAA...``"""
    purposes: Many[Annotated[Purpose, Strict(False)]] = tuple(Purpose)
    """left out: all"""
    valid_from: Annotated[date, Strict(False)] | None = None
    """first day"""
    valid_until: Annotated[date, Strict(False)] | None = None
    """last day"""
    revoked: Annotated[date, Strict(False)] | None = None
    """day from which its signatures do not count, because others may have had the key"""


class KeyList(Model):
    """Content of a list of trusted keys."""

    format: Literal["fsw_trusted_keys"] = "fsw_trusted_keys"
    version: Literal[1] = 1
    keys: Annotated[Many[TrustedKey], Field(min_length=1)]


class Signer(Model):
    """Signer of a file, and the time."""

    name: str = ""
    """name in the list of trusted keys"""
    key: str
    """fingerprint as in ``ssh-keygen -l``"""
    signed_at: Annotated[AwareDatetime, Strict(False)]

    @property
    def words(self) -> str:
        """Text for people."""
        owner = f"{self.name} (key {self.key})" if self.name else f"key {self.key}"
        return f"{owner} at {self.signed_at.isoformat(timespec='seconds')}"


@dataclass(frozen=True, slots=True)
class SigningKey:
    """A signing key and its public half."""

    signer: CryptoSigner
    public: str


def default_key() -> Path:
    """Default path of the key, in the user's configuration, outside any repository."""
    configured = os.environ.get("XDG_CONFIG_HOME", "")
    return (
        (Path(configured) if os.path.isabs(configured) else Path.home() / ".config")
        / "fsw-control"
        / "evidence_key"
    )


def public_path(path: Path) -> Path:
    """Path of the public key that belongs to a private one."""
    return path.with_name(f"{path.name}.pub")


def signature_path(path: Path) -> Path:
    """Path of a file's signature."""
    return path.with_name(path.name + SUFFIX)


def make_key(path: Path, comment: str = "fsw-control") -> str:
    """Create a key pair, ``path`` (readable by its owner only) and ``path.pub``.

    Returns the fingerprint.

    Raises
    ------
    InputError
        If one of the files exists, or a library is not installed.
    OSError
        If a file cannot be written.
    """
    for file in (path, public_path(path)):
        if os.path.lexists(file):
            raise InputError(f"{file} exists; a key is never replaced, choose another name")
    _EXTRA.need("signatures")
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    key = Ed25519PrivateKey.generate()
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    write_whole(
        path, key.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption()), 0o600
    )
    line = _line(key.public_key())
    write_whole(public_path(path), f"{line} {comment}\n")
    return fingerprint(line)


def load_private(path: Path) -> SigningKey:
    """Load a signing key.

    Raises
    ------
    InputError
        If it is missing, readable by others, or not an unencrypted Ed25519 key of OpenSSH.
    """
    _EXTRA.need("signatures")
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_ssh_private_key
    from securesystemslib.signer import CryptoSigner

    if not path.exists():
        raise InputError(f"key {path}: there is none; make one with 'fsw.py bag keygen'")
    try:
        data = read_private("key", path)
    except ValueError as error:
        raise InputError(str(error)) from None
    try:
        key = load_ssh_private_key(data, password=None)
    except Exception as error:  # cryptography raises various kinds
        raise InputError(
            f"key {path}: cannot be used: {' '.join(str(error).split())[:150]}"
        ) from None
    if not isinstance(key, Ed25519PrivateKey):
        raise InputError(f"key {path}: is no Ed25519 key; make one with 'fsw.py bag keygen'")
    line = _line(key.public_key())
    return SigningKey(CryptoSigner(key, _library_key(line)), line)


def load_trusted(paths: Sequence[Path]) -> tuple[TrustedKey, ...]:
    """Load trusted keys: public keys, valid for everything and for ever, and YAML lists of keys.

    Raises
    ------
    InputError
        If a file cannot be read or is invalid.
    """
    keys: list[TrustedKey] = []
    for path in paths:
        try:
            text = read_regular(path).decode("utf-8", "replace")
        except OSError as error:
            raise InputError(
                f"trusted key {path}: {error.strerror}; give that of the signer"
            ) from None
        if text.startswith("ssh-"):
            keys.append(TrustedKey(name="", key=text))
        else:
            keys += validate(KeyList, content_of(text, str(path)), str(path)).keys
        for entry in keys:
            try:
                _library_key(entry.key)
            except MissingExtraError:
                raise
            except Exception:  # cryptography raises various kinds
                raise InputError(
                    f"trusted key {path}: {entry.name} is no line 'ssh-ed25519 AAAA...'"
                ) from None
    return tuple(keys)


def fingerprint(line: str) -> str:
    """Fingerprint of a public key, as in ``ssh-keygen -l``."""
    digest = hashlib.sha256(base64.b64decode(line.split()[1])).digest()
    return "SHA256:" + base64.b64encode(digest).decode().rstrip("=")


def sign(data: bytes, name: str, purpose: Purpose, key: SigningKey, now: datetime) -> str:
    """Sign the content of a file; returns the text of the signature file."""
    from securesystemslib.dsse import Envelope

    digest = hashlib.sha256(data).hexdigest()
    statement = Statement(
        purpose=purpose, name=name, sha256=digest, signed_at=now.astimezone(UTC), key=key.public
    )
    envelope = Envelope(statement.model_dump_json().encode(), PAYLOAD_TYPE, {})
    envelope.sign(key.signer)
    return json.dumps(envelope.to_dict(), indent=1) + "\n"


def verify(
    data: bytes,
    text: str,
    purpose: Purpose,
    trusted: Sequence[TrustedKey] | None,
    name: object = "",
) -> Signer:
    """Verify a signature of the content of file ``name``; returns its signer.

    Without ``trusted`` any key is accepted, e.g. to detect changes of a file.

    Raises
    ------
    EvidenceError
        If it is not a signature, not of these bytes, made for another purpose, or by a key that
        does not count for it.
    """
    _EXTRA.need("signatures")
    try:
        statement = _signed_statement(text)
    except Exception:  # of JSON, base64, pydantic, securesystemslib and cryptography
        raise EvidenceError(finding(Code.SIGNATURE_DAMAGED, name)) from None
    if statement.sha256 != hashlib.sha256(data).hexdigest():
        raise EvidenceError(finding(Code.CONTENT_CHANGED, name))
    if statement.purpose is not purpose:
        raise EvidenceError(
            finding(Code.OTHER_PURPOSE, name, signed=statement.purpose, needed=purpose)
        )
    signer = Signer(key=fingerprint(statement.key), signed_at=statement.signed_at)
    return signer if trusted is None else check_trust(signer, purpose, trusted, name)


def check_trust(
    signer: Signer, purpose: Purpose, trusted: Sequence[TrustedKey], name: object
) -> Signer:
    """The signer with its owner's name; EvidenceError if the key is not valid for this use."""
    known = {fingerprint(entry.key): entry for entry in trusted}
    entry = known.get(signer.key)
    if entry is None:
        raise EvidenceError(
            finding(
                Code.KEY_UNKNOWN,
                name,
                key=signer.key,
                trusted=", ".join(sorted(known)) or "none is given",
            )
        )
    owner, day = entry.name or "the owner", signer.signed_at.astimezone(UTC).date()
    fields = {
        "name": owner,
        "key": signer.key,
        "at": signer.signed_at.isoformat(timespec="seconds"),
    }
    if purpose not in entry.purposes:
        raise EvidenceError(finding(Code.KEY_PURPOSE, name, **fields, needed=purpose))
    for code, limit, broken in (
        (
            Code.KEY_EARLY,
            entry.valid_from,
            entry.valid_from is not None and day < entry.valid_from,
        ),
        (
            Code.KEY_EXPIRED,
            entry.valid_until,
            entry.valid_until is not None and day > entry.valid_until,
        ),
        (Code.KEY_REVOKED, entry.revoked, entry.revoked is not None and day >= entry.revoked),
    ):
        if broken:
            raise EvidenceError(finding(code, name, **fields, limit=limit))
    return signer.changed(name=entry.name)


def check_revocation(
    signer: Signer, shown_at: Sequence[datetime], trusted: Sequence[TrustedKey], name: object
) -> Finding | None:
    """What there is to say of a signature by a key that was revoked later than the signer states.

    Who stole the key can state any time. So the first of ``shown_at`` counts: when others signed
    for something that contains this signature. Without any, it cannot be decided.
    """
    known = {fingerprint(entry.key): entry.revoked for entry in trusted}
    limit = known.get(signer.key)
    if limit is None:
        return None
    at = signer.signed_at.isoformat(timespec="seconds")
    fields = {"name": signer.name or "the owner", "key": signer.key, "at": at, "limit": limit}
    if not shown_at:
        return finding(Code.REVOCATION_BY_OWN_CLOCK, name, **fields)
    first = min(shown_at).astimezone(UTC)
    if first.date() < limit:
        return None
    shown = first.isoformat(timespec="seconds")
    return finding(Code.KEY_REVOKED_BEFORE_SHOWN, name, **fields, shown_at=shown)


def verify_file(
    path: Path, purpose: Purpose, trusted: Sequence[TrustedKey] | None, name: object = ""
) -> Signer:
    """Verify a file by the signature beside it, as :func:`verify`; EvidenceError without one."""
    name = name or path
    try:
        data, text = (
            read_regular(path),
            read_regular(signature_path(path)).decode("utf-8", errors="replace"),
        )
    except FileNotFoundError:
        raise EvidenceError(
            finding(Code.NOT_SIGNED if path.exists() else Code.MISSING, name)
        ) from None
    except OSError as error:
        raise EvidenceError(finding(Code.UNREADABLE, name, reason=error.strerror)) from None
    return verify(data, text, purpose, trusted, name)


def _signed_statement(text: str) -> Statement:
    """Statement of an envelope, verified with the key that it names; raises any exception."""
    from securesystemslib.dsse import Envelope

    envelope = Envelope.from_dict(json_content_of(text, "signature"))
    statement = Statement.model_validate_json(envelope.payload)
    if envelope.payload_type != PAYLOAD_TYPE:
        raise ValueError("made for something else")
    envelope.verify([_library_key(statement.key)], 1)
    return statement


def _library_key(line: str) -> Any:
    """Convert OpenSSH's public key for securesystemslib; invalid ones raise various exceptions."""
    _EXTRA.need("signatures")
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_ssh_public_key
    from securesystemslib.signer import SSlibKey

    key = load_ssh_public_key(line.encode())
    if not isinstance(key, Ed25519PublicKey):
        raise ValueError("is no Ed25519 key")
    return SSlibKey.from_crypto(key, keyid=fingerprint(line))


def _line(public: Any) -> str:
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    return str(public.public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH).decode())
