"""Certificates of OPC UA applications: checked before they are used, and made for tests."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from fsw_control.private_file import read_private
from fsw_machine.machine_file import Security

_KEY_BITS = 2048


class SecurityError(ValueError):
    """A certificate, key or password cannot be used; the message says which, why and what to do."""


def now() -> datetime:
    """The time against which certificates are checked."""
    return datetime.now(UTC)


def read_certificate(field: str, path: Path, at: datetime) -> x509.Certificate:
    """The certificate in a file (DER or PEM) that is valid at a time.

    Raises
    ------
    SecurityError
        When it cannot be read, has expired or is not valid yet.
    """
    data = _read(field, path)
    try:
        load = x509.load_pem_x509_certificate if data.startswith(b"-----") else x509.load_der_x509_certificate
        certificate = load(data)
    except ValueError:
        raise SecurityError(f"{field}: {path} holds no certificate in DER or PEM") from None
    if at > certificate.not_valid_after_utc:
        raise SecurityError(f"{field}: {path} expired on {certificate.not_valid_after_utc:%Y-%m-%d}; make a new one")
    if at < certificate.not_valid_before_utc:
        since = f"{certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC"
        raise SecurityError(f"{field}: {path} is not valid before {since}; check the clock of this computer")
    return certificate


def application_uri(certificate: x509.Certificate) -> str:
    """URI of the application that a certificate was made for; empty where it names none."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ""
    return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), "")


def check(security: Security, at: datetime) -> tuple[str, x509.Certificate]:
    """Check all files of a connection; returns the own application's URI and the server's certificate.

    Raises
    ------
    SecurityError
        When one of them cannot be used.
    """
    own = read_certificate("security.certificate", security.certificate, at)
    uri = application_uri(own)
    if not uri:
        text = "names no application URI (subjectAltName), which OPC UA needs; make a new one"
        raise SecurityError(f"security.certificate: {security.certificate} {text}")
    data = secret("security.private_key", security.private_key)
    try:
        load = serialization.load_pem_private_key if b"-----" in data else serialization.load_der_private_key
        key = load(data, password=None)
    except (ValueError, TypeError):
        raise SecurityError(
            f"security.private_key: {security.private_key} holds no private key without a password in DER or PEM"
        ) from None
    if key.public_key() != own.public_key():
        text = f"does not belong to security.certificate {security.certificate}"
        raise SecurityError(f"security.private_key: {security.private_key} {text}")
    return uri, read_certificate("security.server_certificate", security.server_certificate, at)


def thumbprint(certificate: x509.Certificate) -> str:
    """SHA-1 of a certificate, by which OPC UA tools show it."""
    return certificate.fingerprint(hashes.SHA1()).hex()


def der(certificate: x509.Certificate) -> bytes:
    """A certificate in the form in which it is sent."""
    return certificate.public_bytes(serialization.Encoding.DER)


def make(
    folder: Path, name: str, uri: str, hosts: Sequence[str], days: int = 365, start: datetime | None = None
) -> tuple[Path, Path]:
    """Make a key and a self-signed certificate for tests: ``<name>.der`` and ``<name>_key.pem`` in ``folder``.

    Parameters
    ----------
    folder : Path
        Made if need be.
    name : str
    uri : str
        Of the application.
    hosts : sequence of str
        Host names and addresses.
    days : int
        How long it is valid.
    start : datetime, optional
        From when; an hour ago by default.

    Returns
    -------
    tuple of Path
        Certificate and key.
    """
    folder.mkdir(parents=True, exist_ok=True)
    key = rsa.generate_private_key(public_exponent=65537, key_size=_KEY_BITS)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    begin = now() - timedelta(hours=1) if start is None else start
    usages = {"digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_cert_sign"}
    every = ("key_agreement", "crl_sign", "encipher_only", "decipher_only", *usages)
    purposes = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    certificate = (
        x509.CertificateBuilder(subject, subject, key.public_key(), x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(begin + timedelta(days=days))
        .add_extension(
            x509.SubjectAlternativeName([x509.UniformResourceIdentifier(uri), *map(_general_name, hosts)]), False
        )
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        .add_extension(x509.KeyUsage(**{usage: usage in usages for usage in every}), True)
        .add_extension(x509.ExtendedKeyUsage(purposes), False)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
        .sign(key, hashes.SHA256())
    )
    files = folder / f"{name}.der", folder / f"{name}_key.pem"
    files[0].write_bytes(der(certificate))
    pem = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    with open(os.open(files[1], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(key.private_bytes(*pem))
    return files


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def secret(field: str, path: Path) -> bytes:
    """Content of a file with a key or password; raises SecurityError, also where others may read it."""
    try:
        return read_private(field, path)
    except ValueError as error:
        raise SecurityError(str(error)) from None


def _read(field: str, path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise SecurityError(f"{field}: cannot read {path}: {error.strerror}") from None
