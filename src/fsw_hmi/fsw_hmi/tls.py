"""Certificate and key of the page, tested before the first connection."""

from __future__ import annotations

import ssl
from pathlib import Path

from fsw_control.schema.files import open_regular, read_private


def context(certificate: str, key: str) -> ssl.SSLContext | None:
    """TLS context of the server; None without files.

    Raises
    ------
    ValueError
        When a file cannot be used, others may read the key, the two do not belong together, or the
        certificate has expired or is not valid yet; the message says which and what to do.
    """
    if not certificate and not key:
        return None
    if not certificate or not key:
        raise ValueError("tls_cert, tls_key: give both or neither")
    cert_file, key_file = Path(certificate).expanduser(), Path(key).expanduser()
    try:
        open_regular(cert_file).close()
    except OSError as error:
        raise ValueError(f"tls_cert: cannot read {cert_file}: {error.strerror}") from None
    if b"PRIVATE KEY-----" not in read_private("tls_key", key_file):
        raise ValueError(f"tls_key: {key_file} holds no private key in PEM")
    made = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    made.minimum_version = ssl.TLSVersion.TLSv1_2  # the default of some builds is older
    try:
        made.load_cert_chain(cert_file, key_file, password=lambda: "")
    except ssl.SSLError as error:
        raise ValueError(_why_not(error, cert_file, key_file)) from None
    _try(made, cert_file)
    return made


def _why_not(error: ssl.SSLError, certificate: Path, key: Path) -> str:
    if error.reason == "KEY_VALUES_MISMATCH":
        return f"tls_key: {key} does not belong to tls_cert {certificate}"
    try:
        ssl.create_default_context(cafile=certificate)
    except ssl.SSLError:
        return f"tls_cert: {certificate} holds no certificate in PEM"
    why = f"holds no private key in PEM without a password, or the certificate is too weak ({error.reason})"
    return f"tls_key: {key} {why}"


def _try(server_side: ssl.SSLContext, certificate: Path) -> None:
    """Test handshake in memory with a client that trusts only this certificate."""
    trusting = ssl.create_default_context(cafile=certificate)
    trusting.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    trusting.check_hostname = False
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = [
        trusting.wrap_bio(to_client, to_server),
        server_side.wrap_bio(to_server, to_client, server_side=True),
    ]
    try:
        for end in (*ends, *ends):
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                pass
    except ssl.SSLCertVerificationError as error:
        raise ValueError(
            f"tls_cert: {certificate}: {error.verify_message}; make a new one"
        ) from None
    except ssl.SSLError as error:
        raise ValueError(f"tls_cert: {certificate} cannot be used: {error.reason}") from None
