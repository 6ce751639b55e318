"""Keys, signatures and lists of trusted keys; keys also against OpenSSH where it is installed."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from datetime import UTC, datetime
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control.schema.models import InputError
from fsw_recorder.findings import Code, EvidenceError
from fsw_recorder.signature import (
    PAYLOAD_TYPE,
    Purpose,
    Signer,
    Stated,
    TrustedKey,
    check_trust,
    envelope,
    fingerprint,
    load_private,
    load_trusted,
    sign,
    signature_path,
    signer_of,
)
from fsw_test_support.keys import make_key

pytest.importorskip(
    "cryptography", reason="not installed: pip install -r requirements/signing.lock"
)
pytest.importorskip(
    "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
)

from securesystemslib.dsse import Envelope

MESSAGE = b'{"number": 1}\n'
NOW = datetime(2026, 11, 25, 12, 0, tzinfo=UTC)
NEEDS_OPENSSH = pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="no ssh-keygen")


@pytest.fixture(scope="module")
def key(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("keys") / "deeper" / "key"
    make_key(path)
    return path


@pytest.fixture(scope="module")
def signature(key: Path) -> str:
    return sign(MESSAGE, "message", Purpose.MANIFEST, load_private(key), NOW)


def public(key: Path) -> Path:
    return key.with_name(f"{key.name}.pub")


def verify(data: bytes, text: str, purpose: Purpose, trusted: object) -> Signer | None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "message"
        path.write_bytes(data)
        signature_path(path).write_text(text, encoding="utf-8", errors="surrogatepass")
        return signer_of(path, purpose, trusted)  # type: ignore[arg-type]


def code_of(
    data: bytes, text: str, trusted: object = None, purpose: Purpose = Purpose.MANIFEST
) -> Code | None:
    """Of what is wrong; None: nothing."""
    try:
        verify(data, text, purpose, trusted)
    except EvidenceError as error:
        return error.findings[0].code
    return None


def test_a_signature_holds_for_its_content_its_purpose_and_its_key(
    key: Path, signature: str, tmp_path: Path
) -> None:
    trusted = load_trusted([public(key)])
    signer = verify(MESSAGE, signature, Purpose.MANIFEST, trusted)
    assert signer.key.startswith("SHA256:") and signer.signed_at == NOW
    make_key(tmp_path / "other")
    other = load_trusted([tmp_path / "other.pub"])
    assert code_of(MESSAGE, signature) is code_of(MESSAGE, signature, (*other, *trusted)) is None
    assert code_of(MESSAGE + b" ", signature, trusted) is Code.CONTENT_CHANGED
    assert code_of(MESSAGE, signature, trusted, Purpose.PROCEDURE) is Code.SIGNATURE_DAMAGED
    assert (
        code_of(MESSAGE, signature, other) is code_of(MESSAGE, signature, ()) is Code.KEY_UNKNOWN
    )


def test_a_statement_cannot_be_edited(signature: str) -> None:
    envelope = json.loads(signature)
    payload = base64.b64decode(envelope["payload"])
    for edited in (
        {"payload": base64.b64encode(payload.replace(b"2026", b"2025")).decode()},
        {"payloadType": "application/json"},
        {"signatures": []},
    ):
        assert code_of(MESSAGE, json.dumps(envelope | edited)) is Code.SIGNATURE_DAMAGED


@settings(deadline=None)
@given(data=st.data())
def test_a_damaged_signature_has_its_code(signature: str, data: st.DataObject) -> None:
    index = data.draw(st.integers(0, len(signature) - 2))
    for text in (
        signature[:index],
        data.draw(st.text(max_size=200)),
        signature[:index] + "A" + signature[index + 1 :],
    ):
        assert code_of(MESSAGE, text) in (
            {Code.SIGNATURE_DAMAGED} if text != signature else {None}
        )


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({}, None),
        ({"valid_from": "2026-11-25", "valid_until": "2026-11-25", "revoked": "2026-11-26"}, None),
        ({"purposes": ["attestation", "procedure"]}, Code.KEY_PURPOSE),
        ({"valid_from": "2026-11-26"}, Code.KEY_EARLY),
        ({"valid_until": "2026-11-24"}, Code.KEY_EXPIRED),
        ({"revoked": "2026-11-25"}, Code.KEY_REVOKED),
    ],
)
def test_keys_have_a_purpose_expire_and_are_revoked(
    key: Path, signature: str, tmp_path: Path, fields: dict[str, object], code: Code | None
) -> None:
    entry = {"name": "machine 1", "key": public(key).read_text(), **fields}
    path = tmp_path / "keys.yaml"
    path.write_text(yaml.safe_dump({"format": "fsw_trusted_keys", "version": 1, "keys": [entry]}))
    trusted = load_trusted([path])
    assert code_of(MESSAGE, signature, trusted) is code
    if code is None:
        assert verify(MESSAGE, signature, Purpose.MANIFEST, trusted).name == "machine 1"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nonsense",
        "format: other",
        "ssh-ed25519 AAAA",
        "format: fsw_trusted_keys\nversion: 1\nkeys: []",
    ],
)
def test_invalid_key_error_is_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "key"
    path.write_text(text)
    path.chmod(0o600)
    for load in (load_private, lambda path: load_trusted([path])):
        with pytest.raises(InputError) as caught:
            load(path)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="ssh-keygen"):
        load_private(tmp_path / "none")


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o602])
def test_a_key_that_others_may_read_is_refused(key: Path, tmp_path: Path, mode: int) -> None:
    copy = tmp_path / "key"
    shutil.copyfile(key, copy)
    copy.chmod(mode)
    with pytest.raises(InputError, match="chmod 600"):
        load_private(copy)


def test_files_with_their_signatures(key: Path, tmp_path: Path) -> None:
    path = tmp_path / "file"

    def code(required: bool = True) -> Code:
        with pytest.raises(EvidenceError) as caught:
            signer_of(path, Purpose.MANIFEST, None, required)
        return caught.value.findings[0].code

    path.write_bytes(MESSAGE)
    assert signer_of(path, Purpose.MANIFEST, None) is None and code() is Code.NOT_SIGNED
    signature_path(path).write_text(
        sign(MESSAGE, path.name, Purpose.MANIFEST, load_private(key), NOW)
    )
    assert isinstance(signer_of(path, Purpose.MANIFEST, None), Signer)
    assert code() is Code.KEY_UNKNOWN, "required, and no key is trusted"
    path.unlink()
    assert code(required=False) is Code.MISSING


def test_envelope_with_another_statement_is_rejected(key: Path) -> None:
    """Of another form, or of another payload: a valid signature does not count for it."""
    own, stated = load_private(key), Stated(signed_at=NOW)
    hashes = {"message": hashlib.sha256(MESSAGE).hexdigest()}
    text = envelope(hashes, Purpose.MANIFEST, stated, own)
    assert code_of(MESSAGE, text) is None
    content = base64.b64decode(json.loads(text)["payload"])
    naive = content.replace(b"2026-11-25T12:00:00Z", b"2026-11-25T12:00:00")
    assert naive != content, "a time without a zone"
    for payload, kind in ((content, "application/json"), (naive, PAYLOAD_TYPE)):
        other = Envelope(payload, kind, {})
        other.sign(own)
        assert code_of(MESSAGE, json.dumps(other.to_dict())) is Code.SIGNATURE_DAMAGED


@NEEDS_OPENSSH
def test_openssh_s_keys_sign(tmp_path: Path) -> None:
    made, environment = tmp_path / "made", {**os.environ, "HOME": str(tmp_path)}

    def run(*words: object) -> str:
        command = ["ssh-keygen", *map(str, words)]
        return subprocess.run(
            command, capture_output=True, check=True, env=environment
        ).stdout.decode()

    run("-q", "-t", "ed25519", "-N", "", "-f", made)
    text = sign(MESSAGE, "message", Purpose.MANIFEST, load_private(made), NOW)
    trusted: tuple[TrustedKey, ...] = load_trusted([public(made)])
    assert verify(MESSAGE, text, Purpose.MANIFEST, trusted).key in run("-l", "-f", made)
    run("-q", "-t", "ed25519", "-N", "secret", "-f", tmp_path / "locked")
    with pytest.raises(InputError, match="cannot be used"):
        load_private(tmp_path / "locked")


@pytest.mark.parametrize(
    ("revoked", "shown_day", "code"),
    [
        (None, 30, None),
        ("2026-11-26", None, None),
        ("2026-11-27", 26, None),
        ("2026-11-27", 27, Code.KEY_REVOKED),
        ("2026-11-26", 26, Code.KEY_REVOKED),
    ],
)
def test_a_revoked_key_needs_a_signature_of_others_in_time(
    key: Path, revoked: str | None, shown_day: int | None, code: Code | None
) -> None:
    """The signer's own clock says 25 November, but a thief can set it."""
    public = load_private(key).public_key.keyid
    trusted = [TrustedKey.model_validate({"name": "machine", "key": public, "revoked": revoked})]
    signer = Signer(key=fingerprint(public), signed_at=NOW)
    shown_at = NOW.replace(day=shown_day) if shown_day else None
    try:
        assert check_trust(signer, Purpose.MANIFEST, trusted, "", shown_at).name == "machine"
        found = None
    except EvidenceError as error:
        found = error.findings[0].code
    assert found is code
