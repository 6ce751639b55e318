"""The token's file, and the token of a run."""

import pytest

from fsw_hmi import logins, users


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
    "content", [b"", b"short", b"eleven char", b"\n\n", b"two words\nin two lines", b"\xff" * 12]
)
def test_file_without_a_token_is_refused(tmp_path, content):
    with pytest.raises(ValueError, match="token_file"):
        users.read_token(write(tmp_path / "token", content))


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match="No such file"):
        users.read_token(tmp_path / "none")


def test_every_run_has_its_own_token():
    assert users.new_token() != users.new_token()
    assert len(users.new_token()) >= 16


def test_different_wrong_tokens_of_one_client_within_a_minute_shut_it_out():
    wrong = logins.WrongLogins()
    for number in range(5):
        assert wrong.left_s("a", 10.0 * number) == 0.0
        assert wrong.add("a", b"%d" % number, 10.0 * number)
    assert wrong.left_s("a", 59.5) == 0.5
    assert wrong.left_s("b", 59.5) == 0.0
    assert wrong.left_s("a", 60.0) == 0.0  # the first is forgotten
    assert wrong.add("a", b"x", 60.0)
    assert wrong.left_s("a", 60.0) == 10.0


def test_the_same_wrong_token_counts_once_and_a_wrong_one_now_and_then_not():
    wrong = logins.WrongLogins()
    for number in range(100):
        new = wrong.add("pages that are out of date", b"old", 0.1 * number)
        assert (new, wrong.left_s("pages that are out of date", 10.0)) == (number == 0, 0.0)
        assert wrong.add("a person", b"%d" % number, 20.0 * number)
        assert wrong.left_s("a person", 20.0 * number) == 0.0


def test_many_clients_take_no_more_memory_than_a_thousand():
    wrong = logins.WrongLogins()
    for number in range(3000):
        wrong.add(str(number), b"x", 0.0)
    assert len(wrong._given_s) == 1000
