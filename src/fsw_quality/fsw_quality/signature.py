"""Ed25519 keys and detached signatures, both in the formats of OpenSSH, so that ``ssh-keygen -Y`` reads them, too.

Format of a signature: https://github.com/openssh/openssh-portable/blob/master/PROTOCOL.sshsig
"""

from __future__ import annotations

import base64
import hashlib
import os
import stat
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fsw_schema.files import read_regular, write_whole
from fsw_schema.models import InputError

if TYPE_CHECKING:  # of the extra quality
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

#: what a signature is for; one made for something else does not count
NAMESPACE = "fsw-control"
SUFFIX = ".sig"
_MAGIC, _KIND, _HASH = b"SSHSIG", b"ssh-ed25519", b"sha512"
_BEGIN, _END = "-----BEGIN SSH SIGNATURE-----", "-----END SSH SIGNATURE-----"
_LINE = 70
#: places in an Ed25519 signature of OpenSSH: where the key and the namespace begin, and what is behind the namespace
_KEY_AT, _NAMESPACE_AT, _BEHIND, _VALUE_BYTES = 33, 69, 101, 64


@dataclass(frozen=True, slots=True)
class PublicKey:
    """A key that signatures are checked with: its 32 bytes."""

    raw: bytes

    @property
    def fingerprint(self) -> str:
        """As ``ssh-keygen -l`` shows it."""
        return "SHA256:" + base64.b64encode(hashlib.sha256(_key_blob(self.raw)).digest()).decode().rstrip("=")


class LibraryMissingError(InputError):
    """``cryptography`` is not installed."""


def default_key() -> Path:
    """Where the key is that is used unless another is given: in the user's configuration, in no repository."""
    configured = os.environ.get("XDG_CONFIG_HOME", "")
    return (Path(configured) if os.path.isabs(configured) else Path.home() / ".config") / "fsw-control" / "evidence_key"


def make_key(path: Path, comment: str = "fsw-control") -> PublicKey:
    """Make a pair of keys: ``path`` for its owner alone, and ``path.pub``.

    Raises
    ------
    InputError
        One of the files exists, or ``cryptography`` is not installed.
    OSError
        A file cannot be written.
    """
    public_path = path.with_name(f"{path.name}.pub")
    for file in (path, public_path):
        if os.path.lexists(file):
            raise InputError(f"{file} exists; a key is never replaced, choose another name")
    _check_installed()
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    key = Ed25519PrivateKey.generate()
    text = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.OpenSSH, serialization.NoEncryption()
    )
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    write_whole(path, text, 0o600)
    line = key.public_key().public_bytes(serialization.Encoding.OpenSSH, serialization.PublicFormat.OpenSSH)
    write_whole(public_path, line + f" {comment}\n".encode())
    return PublicKey(key.public_key().public_bytes_raw())


def load_private(path: Path) -> Ed25519PrivateKey:
    """The key that signs.

    Raises
    ------
    InputError
        There is none, others may read it, or it is no unencrypted Ed25519 key of OpenSSH.
    """
    _check_installed()
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    try:
        mode = path.stat().st_mode
        if mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise InputError(
                f"key {path}: others may read or change it (mode {stat.S_IMODE(mode):o}); chmod 600 {path}"
            )
        data = read_regular(path)
    except OSError as error:
        raise InputError(f"key {path}: {error.strerror}; make one with 'fsw.py bag keygen'") from None
    try:
        key = serialization.load_ssh_private_key(data, password=None)
    except Exception as error:  # cryptography raises many kinds
        raise InputError(f"key {path}: cannot be used: {' '.join(str(error).split())[:150]}") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise InputError(f"key {path}: is no Ed25519 key; make one with 'fsw.py bag keygen'")
    return key


def load_public(path: Path) -> PublicKey:
    """A public key, ``ssh-ed25519 AAAA...``.

    Raises
    ------
    InputError
        It cannot be read, or is no such key.
    """
    _check_installed()
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    key = None
    try:
        key = serialization.load_ssh_public_key(read_regular(path))
    except OSError as error:
        raise InputError(f"public key {path}: {error.strerror}; give that of the signer with --key") from None
    except Exception:  # cryptography raises many kinds
        pass
    if not isinstance(key, Ed25519PublicKey):
        raise InputError(f"public key {path}: is no line 'ssh-ed25519 AAAA...'")
    return PublicKey(key.public_bytes_raw())


def sign(message: bytes, key: Ed25519PrivateKey) -> str:
    """Detached signature of a message, armoured."""
    blob = _blob(key.public_key().public_bytes_raw(), NAMESPACE.encode(), key.sign(_signed(message)))
    text = base64.b64encode(blob).decode()
    return "\n".join([_BEGIN, *(text[at : at + _LINE] for at in range(0, len(text), _LINE)), _END, ""])


def verify(message: bytes, armoured: str, trusted: Sequence[PublicKey] | None) -> PublicKey:
    """Check a signature; returns the key of its signer.

    Without ``trusted`` keys any will do, e.g. to see whether a file was changed.

    Raises
    ------
    InputError
        It is no signature, was made for something else, by a key that is not trusted, or of other bytes.
    """
    _check_installed()
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    signer, value = _parse(armoured)
    if trusted is not None and signer not in trusted:
        known = ", ".join(key.fingerprint for key in trusted) or "none"
        raise InputError(f"signed by key {signer.fingerprint}, which is not the trusted one ({known})")
    try:
        Ed25519PublicKey.from_public_bytes(signer.raw).verify(value, _signed(message))
    except InvalidSignature:
        raise InputError("the signature does not fit: it was changed after it was signed") from None
    return signer


def signature_path(path: Path) -> Path:
    """Where the signature of a file is."""
    return path.with_name(path.name + SUFFIX)


def verify_file(path: Path, trusted: Sequence[PublicKey] | None) -> PublicKey | None:
    """Check a file with a signature beside it; returns the key of its signer, None where there is no signature.

    Raises
    ------
    InputError
        The signature is damaged, or not of these bytes, or not by a trusted key.
    """
    try:
        armoured = read_regular(signature_path(path)).decode("ascii", errors="replace")
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{signature_path(path)}: {error.strerror}") from None
    try:
        return verify(read_regular(path), armoured, trusted)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _parse(armoured: str) -> tuple[PublicKey, bytes]:
    """Key and value of a signature."""
    text, blob = armoured.strip(), b""
    if text.startswith(_BEGIN) and text.endswith(_END):
        with suppress(ValueError):
            blob = base64.b64decode("".join(text.removeprefix(_BEGIN).removesuffix(_END).split()), validate=True)
    raw, value = blob[_KEY_AT : _KEY_AT + 32], blob[-_VALUE_BYTES:]
    namespace = blob[_NAMESPACE_AT:-_BEHIND]
    if blob != _blob(raw, namespace, value):
        raise InputError("the signature is damaged or no Ed25519 signature of OpenSSH's kind")
    if namespace != NAMESPACE.encode():
        raise InputError(f"the signature was made for {namespace.decode(errors='replace')!r}, not for {NAMESPACE!r}")
    return PublicKey(raw), value


def _signed(message: bytes) -> bytes:
    """What the key signs in place of a message."""
    return _MAGIC + _strings(NAMESPACE.encode(), b"", _HASH, hashlib.sha512(message).digest())


def _blob(raw: bytes, namespace: bytes, value: bytes) -> bytes:
    """A signature with all that is beside it."""
    return _MAGIC + struct.pack(">I", 1) + _strings(_key_blob(raw), namespace, b"", _HASH, _strings(_KIND, value))


def _key_blob(raw: bytes) -> bytes:
    return _strings(_KIND, raw)


def _strings(*parts: bytes) -> bytes:
    """Each behind its length."""
    return b"".join(struct.pack(">I", len(part)) + part for part in parts)


def _check_installed() -> None:
    try:
        import cryptography  # noqa: F401
    except ImportError:
        raise LibraryMissingError(
            "signatures need cryptography: pip install cryptography, or the extra fsw-control[quality]"
        ) from None
