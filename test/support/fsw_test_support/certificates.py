"""Self-signed certificates of OPC UA applications, for tests."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from fsw_machine.certificates import der, now

_KEY_BITS = 2048


def make(
    folder: Path,
    name: str,
    uri: str,
    hosts: Sequence[str],
    days: int = 365,
    start: datetime | None = None,
) -> tuple[Path, Path]:
    """Make a key and a self-signed certificate for tests.

    ``<name>.der`` and ``<name>_key.pem`` in ``folder``.

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
    usages = {
        "digital_signature",
        "content_commitment",
        "key_encipherment",
        "data_encipherment",
        "key_cert_sign",
    }
    every = ("key_agreement", "crl_sign", "encipher_only", "decipher_only", *usages)
    purposes = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    certificate = (
        x509.CertificateBuilder(subject, subject, key.public_key(), x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(begin + timedelta(days=days))
        .add_extension(
            x509.SubjectAlternativeName(
                [x509.UniformResourceIdentifier(uri), *map(_general_name, hosts)]
            ),
            False,
        )
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        .add_extension(x509.KeyUsage(**{usage: usage in usages for usage in every}), True)
        .add_extension(x509.ExtendedKeyUsage(purposes), False)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
        .sign(key, hashes.SHA256())
    )
    files = folder / f"{name}.der", folder / f"{name}_key.pem"
    files[0].write_bytes(der(certificate))
    pem = (
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    with open(os.open(files[1], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(key.private_bytes(*pem))
    return files


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
