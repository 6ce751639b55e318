"""Keys and signatures, also against OpenSSH where it is installed."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_quality.signature import NAMESPACE, load_private, load_public, make_key, sign, verify
from fsw_schema.models import InputError

pytest.importorskip("cryptography", reason="not installed: pip install -r requirements/quality.lock")

MESSAGE = b'{"number": 1}\n'
NEEDS_OPENSSH = pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="no ssh-keygen")


@pytest.fixture(scope="module")
def key(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("keys") / "deeper" / "key"
    make_key(path)
    return path


@pytest.fixture(scope="module")
def armoured(key: Path) -> str:
    return sign(MESSAGE, load_private(key))


def test_a_key_is_for_its_owner_alone_and_never_replaced(key: Path) -> None:
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    with pytest.raises(InputError, match="never replaced"):
        make_key(key)


def test_a_signature_holds_for_its_message_and_its_key(key: Path, armoured: str, tmp_path: Path) -> None:
    public = load_public(key.with_name("key.pub"))
    assert verify(MESSAGE, armoured, [public]) == public
    with pytest.raises(InputError, match="changed after it was signed"):
        verify(MESSAGE + b" ", armoured, [public])
    other = make_key(tmp_path / "other")
    with pytest.raises(InputError, match=r"signed by key SHA256:\S+, which is not the trusted one \(SHA256:"):
        verify(MESSAGE, armoured, [other])
    assert verify(MESSAGE, armoured, [other, public]) == public


@settings(deadline=None)
@given(at=st.integers(0, len(MESSAGE) - 1), bit=st.integers(0, 7))
def test_any_flipped_bit_of_the_message_is_found(key: Path, armoured: str, at: int, bit: int) -> None:
    flipped = bytearray(MESSAGE)
    flipped[at] ^= 1 << bit
    with pytest.raises(InputError):
        verify(bytes(flipped), armoured, [load_public(key.with_name("key.pub"))])


@settings(deadline=None)
@given(data=st.data())
def test_a_damaged_signature_is_one_line(key: Path, armoured: str, data: st.DataObject) -> None:
    trusted = [load_public(key.with_name("key.pub"))]
    cut = data.draw(st.integers(0, len(armoured) - 30))
    texts = [armoured[:cut], data.draw(st.text(max_size=200)), armoured[:cut] + "A" + armoured[cut + 1 :]]
    for text in texts:
        try:
            verify(MESSAGE, text, trusted)
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert text == armoured


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "make one with 'fsw.py bag keygen'"),
        ("", "cannot be used"),
        ("nonsense", "cannot be used"),
    ],
)
def test_what_is_no_key_is_one_line(tmp_path: Path, text: str | None, said: str) -> None:
    path = tmp_path / "key"
    if text is not None:
        path.write_text(text)
        path.chmod(0o600)
    with pytest.raises(InputError, match=said) as caught:
        load_private(path)
    assert "\n" not in str(caught.value)
    if text is not None:
        with pytest.raises(InputError, match="is no line 'ssh-ed25519"):
            load_public(path)


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o602])
def test_a_key_that_others_may_read_is_refused(key: Path, tmp_path: Path, mode: int) -> None:
    copy = tmp_path / "key"
    shutil.copyfile(key, copy)
    copy.chmod(mode)
    with pytest.raises(InputError, match=f"others may read or change it .mode {mode:o}.; chmod 600"):
        load_private(copy)


@NEEDS_OPENSSH
def test_openssh_verifies_our_signatures(key: Path, armoured: str, tmp_path: Path) -> None:
    signature, allowed = tmp_path / "message.sig", tmp_path / "allowed"
    signature.write_text(armoured)
    allowed.write_text(f"weld {key.with_name('key.pub').read_text()}")
    command = ["ssh-keygen", "-Y", "verify", "-f", allowed, "-I", "weld", "-n", NAMESPACE, "-s", signature]
    assert subprocess.run(command, input=MESSAGE, capture_output=True, check=False).returncode == 0
    assert subprocess.run(command, input=MESSAGE + b"x", capture_output=True, check=False).returncode != 0


@NEEDS_OPENSSH
def test_we_verify_openssh_s_keys_and_signatures(tmp_path: Path) -> None:
    made = tmp_path / "made"
    environment = {**os.environ, "HOME": str(tmp_path)}

    def run(*words: object, **options: object) -> bytes:
        command = ["ssh-keygen", *map(str, words)]
        return subprocess.run(command, capture_output=True, check=True, env=environment, **options).stdout  # type: ignore[call-overload, no-any-return]

    run("-q", "-t", "ed25519", "-N", "", "-f", made)
    public = load_public(tmp_path / "made.pub")
    assert public.fingerprint in run("-l", "-f", made).decode()
    text = run("-Y", "sign", "-q", "-f", made, "-n", NAMESPACE, input=MESSAGE).decode()
    assert verify(MESSAGE, text, [public]) == public
    foreign = run("-Y", "sign", "-q", "-f", made, "-n", "git", input=MESSAGE).decode()
    with pytest.raises(InputError, match="made for 'git'"):
        verify(MESSAGE, foreign, [public])
    run("-q", "-t", "ed25519", "-N", "secret", "-f", tmp_path / "locked")
    with pytest.raises(InputError, match="is password-protected"):
        load_private(tmp_path / "locked")
