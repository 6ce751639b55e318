"""``fsw.py hmi user``: the file of named users, from stdin and from a terminal."""

import io

import pytest
from argon2 import PasswordHasher

from fsw.main import main
from fsw_hmi import users

pytestmark = pytest.mark.slow
PASSWORD = "correct horse battery"


class Terminal(io.StringIO):
    """A stdin at which a person sits."""

    def isatty(self):
        return True


@pytest.fixture(autouse=True)
def cheap_hashes(monkeypatch):
    """What a hash costs is the library's."""
    monkeypatch.setattr(users, "HASHER", PasswordHasher(1, 8, 1))


@pytest.fixture
def file(tmp_path):
    return tmp_path / "users.yaml"


@pytest.fixture
def run(file, monkeypatch, capsys):
    def run(*arguments, stdin=""):
        monkeypatch.setattr("sys.stdin", io.StringIO(stdin))
        verb, *others = arguments
        code = main(["hmi", "user", verb, *others, "--file", str(file)])
        printed = capsys.readouterr()
        assert PASSWORD not in printed.out + printed.err
        return code, printed.out, printed.err

    return run


def test_users_are_added_changed_listed_and_removed(run, file):
    assert run("add", "anna", stdin=f"{PASSWORD}\n")[0] == 0
    assert run("add", "Bert.2", stdin=f"{PASSWORD} 2\n")[0] == 0
    assert file.stat().st_mode & 0o777 == 0o600
    assert run("list")[1].split() == ["name", "anna", "Bert.2"]
    assert users.Users(users.read(file)).check("ANNA", PASSWORD) == "anna"
    assert run("passwd", "ANNA", stdin=f"{PASSWORD} 3\n")[0] == 0
    assert run("passwd", "bert.2", stdin=f"{PASSWORD} 4\n")[0] == 0
    known = users.Users(users.read(file))
    assert known.check("anna", PASSWORD) == ""
    assert known.check("anna", f"{PASSWORD} 3") == "anna"
    assert known.check("Bert.2", f"{PASSWORD} 4") == "Bert.2"
    assert run("remove", "Anna")[0] == 0
    assert [user.name for user in users.read(file)] == ["Bert.2"]


@pytest.mark.parametrize(
    ("arguments", "stdin", "text"),
    [
        (["add", "ANNA"], PASSWORD, "anna already"),
        (["add", "\u0430nna"], PASSWORD, "(ASCII letters"),
        (["add", "anna b"], PASSWORD, "(ASCII letters"),
        (["add", "bert"], "short", "12 to 128"),
        (["add", "bert"], "", "12 to 128"),
        (["passwd", "anna"], "x" * 200, "12 to 128"),
        (["passwd", "carl"], PASSWORD, "no 'carl'"),
        (["remove", "carl"], "", "no 'carl'"),
    ],
)
def test_impossible_change_is_one_line_and_keeps_the_file(run, file, arguments, stdin, text):
    run("add", "anna", stdin=f"{PASSWORD}\n")
    before = file.read_bytes()
    code, out, err = run(*arguments, stdin=stdin)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert text in err
    assert file.read_bytes() == before


def test_broken_or_readable_file_is_refused_unchanged(run, file):
    assert "No such file" in run("list")[2]
    file.write_text("- {name: anna}\n")
    file.chmod(0o600)
    error = run("add", "bert", stdin=PASSWORD)[2]
    assert f"users_file: {file}: [0]" in error
    assert "lacks password" in error
    file.chmod(0o644)
    assert f"chmod 600 {file}" in run("add", "bert", stdin=PASSWORD)[2]
    assert file.read_text() == "- {name: anna}\n"


def test_password_is_asked_for_twice_at_a_terminal(run, file, monkeypatch):
    answers = iter([PASSWORD, PASSWORD, PASSWORD, "another one than that"])
    monkeypatch.setattr("getpass.getpass", lambda _: next(answers))
    monkeypatch.setattr("io.StringIO", Terminal)
    assert run("add", "anna")[0] == 0
    code, _, error = run("add", "bert")
    assert code == 1 and "passwords differ" in error
    assert users.Users(users.read(file)).check("anna", PASSWORD) == "anna"
    assert len(users.read(file)) == 1
