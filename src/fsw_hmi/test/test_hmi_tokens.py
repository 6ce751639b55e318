"""The token's file, and the token of a run."""

import pytest

from fsw_hmi import tokens


def write(path, content, mode=0o600):
    path.write_bytes(content)
    path.chmod(mode)
    return path


def test_token_of_a_file(tmp_path):
    assert tokens.read(write(tmp_path / "token", b"  correct horse \n")) == "correct horse"


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o602, 0o644])
def test_file_that_others_may_read_is_refused(tmp_path, mode):
    path = write(tmp_path / "token", b"correct horse", mode)
    with pytest.raises(ValueError, match=f"chmod 600 {path}"):
        tokens.read(path)


@pytest.mark.parametrize("content", [b"", b"short", b"\n\n", b"two words\nin two lines", b"\xff" * 12])
def test_file_without_a_token_is_refused(tmp_path, content):
    with pytest.raises(ValueError, match="token_file"):
        tokens.read(write(tmp_path / "token", content))


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match="No such file"):
        tokens.read(tmp_path / "none")


def test_every_run_has_its_own_token():
    assert tokens.new() != tokens.new()
    assert len(tokens.new()) >= 16
