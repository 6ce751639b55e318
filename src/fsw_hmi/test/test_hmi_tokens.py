"""The token's file, and the token of a run."""

import pytest

from fsw_hmi import users


def write(path, content, mode=0o600):
    path.write_bytes(content)
    path.chmod(mode)
    return path


def test_token_of_a_file(tmp_path):
    assert users.read_token(write(tmp_path / "token", b"  correct horse \n")) == "correct horse"


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o602, 0o644])
def test_file_that_others_may_read_is_refused(tmp_path, mode):
    path = write(tmp_path / "token", b"correct horse", mode)
    with pytest.raises(ValueError, match=f"chmod 600 {path}"):
        users.read_token(path)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"short",
        b"eleven char",
        b"\n\n",
        b"two words\nin two lines",
        b"\xff" * 12,
        b"x" * 129,  # the longest that a login may send has 128
    ],
)
def test_file_without_a_token_is_refused(tmp_path, content):
    with pytest.raises(ValueError, match="token_file"):
        users.read_token(write(tmp_path / "token", content))


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match="No such file"):
        users.read_token(tmp_path / "none")


def test_every_run_has_its_own_token_which_is_checked_like_a_password():
    (known, token), (_, other) = users.of("", ""), users.of("", "")
    assert (known.kind, len(token), token != other) == ("token", 16, True)
    assert known.check("anna", token) == "anna"
    assert [known.check("anna", wrong) for wrong in ("", other, "\ud800")] == [""] * 3
