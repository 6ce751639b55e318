"""Certificates of OPC UA applications, checked before use."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization

from fsw_control.schema.files import read_private, read_regular
from fsw_machine.machine_file import Security


class SecurityError(ValueError):
    """A certificate, key or password is not usable; the message names it, reason and remedy."""


def now() -> datetime:
    """Reference time for the check of certificates."""
    return datetime.now(UTC)


def read_certificate(field: str, path: Path, at: datetime) -> x509.Certificate:
    """Load the certificate in a file (DER or PEM); it must be valid at the given time.

    Raises
    ------
    SecurityError
        If it cannot be read, has expired or is not valid yet.
    """
    data = _read(field, path)
    try:
        is_pem = data.startswith(b"-----")
        load = x509.load_pem_x509_certificate if is_pem else x509.load_der_x509_certificate
        certificate = load(data)
    except ValueError:
        raise SecurityError(f"{field}: {path} holds no certificate in DER or PEM") from None
    if at > certificate.not_valid_after_utc:
        text = f"{path} expired on {certificate.not_valid_after_utc:%Y-%m-%d}"
        raise SecurityError(f"{field}: {text}; make a new one")
    if at < certificate.not_valid_before_utc:
        since = f"{certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC"
        text = f"{path} is not valid before {since}; check the clock of this computer"
        raise SecurityError(f"{field}: {text}")
    return certificate


def application_uri(certificate: x509.Certificate) -> str:
    """URI of the application that a certificate belongs to; empty if it names none."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ""
    return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), "")


def check(security: Security, at: datetime) -> tuple[str, x509.Certificate]:
    """Check all files of a connection; returns our application's URI and the server certificate.

    Raises
    ------
    SecurityError
        If one of them is not usable.
    """
    own = read_certificate("security.certificate", security.certificate, at)
    uri = application_uri(own)
    if not uri:
        text = "names no application URI (subjectAltName), which OPC UA needs; make a new one"
        raise SecurityError(f"security.certificate: {security.certificate} {text}")
    named = f"security.certificate {security.certificate}"
    check_key("security.private_key", security.private_key, own, named)
    return uri, read_certificate("security.server_certificate", security.server_certificate, at)


def check_key(field: str, path: Path, certificate: x509.Certificate, named: str) -> None:
    """Check that a file holds the private key of the certificate called ``named`` in messages.

    Raises
    ------
    SecurityError
        If it does not, or others may read it.
    """
    data = secret(field, path)
    try:
        pem, der_key = serialization.load_pem_private_key, serialization.load_der_private_key
        key = (pem if b"-----" in data else der_key)(data, password=None)
    except (ValueError, TypeError):
        text = f"{path} holds no private key without a password in DER or PEM"
        raise SecurityError(f"{field}: {text}") from None
    if key.public_key() != certificate.public_key():
        raise SecurityError(f"{field}: {path} does not belong to {named}")


def thumbprint(certificate: x509.Certificate) -> str:
    """SHA-1 fingerprint of a certificate, as shown by OPC UA tools."""
    return certificate.fingerprint(hashes.SHA1()).hex()


def der(certificate: x509.Certificate) -> bytes:
    """Encode a certificate for transmission."""
    return certificate.public_bytes(serialization.Encoding.DER)


def secret(field: str, path: Path) -> bytes:
    """Read a file with a key or password; raises SecurityError, also if others may read it."""
    try:
        return read_private(field, path)
    except ValueError as error:
        raise SecurityError(str(error)) from None


def _read(field: str, path: Path) -> bytes:
    try:
        return read_regular(path)
    except OSError as error:
        raise SecurityError(f"{field}: cannot read {path}: {error.strerror}") from None
