"""The file of named users, and the check of their passwords."""

import errno
import re
from types import SimpleNamespace

import pytest
import yaml
from argon2 import Type, extract_parameters
from argon2.exceptions import VerificationError

from fsw_control.schema.models import InputError
from fsw_hmi import users
from fsw_hmi.users import HASHER, Users, new_user

PASSWORD = "correct horse battery"
#: names that are none, or might be taken for another's
CONFUSING = (
    "",
    "x" * 33,
    "a\nb",
    "Ånna",
    "\u0430nna",
    "anna b",
    "anna\u200b",
    "-anna",
    ".",
    "a/b",
    "<b>",
    "anna\x00",
)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "users.yaml"
    users.write(path, [new_user("anna", PASSWORD), new_user("Bert.2", PASSWORD)])
    return path


def test_file_is_private_holds_no_password_and_is_read_as_written(file):
    assert file.stat().st_mode & 0o777 == 0o600
    assert PASSWORD not in file.read_text()
    assert [user.name for user in users.read(file)] == ["anna", "Bert.2"]
    assert len({user.password for user in users.read(file)}) == 2  # each has its own salt


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o602])
def test_file_that_others_may_read_is_refused(file, mode):
    file.chmod(mode)
    with pytest.raises(ValueError, match=f"others may read {file} .*chmod 600"):
        users.read(file)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda entries: entries[1].pop("password"), "[1] lacks password"),
        (
            lambda entries: entries[1].update(role="operate"),
            "[1].role is an unknown key; known: name, password",
        ),
        (
            lambda entries: entries[0].update(password="secret"),
            "[0].password is no hash of Argon2",
        ),
        (
            lambda entries: entries[0].update(
                password="$scrypt$ln=14,r=8,p=5$" + "A" * 22 + "$" + "A" * 43
            ),
            "delete the file and add its users again by 'fsw.py hmi user add'",
        ),
        (lambda entries: entries[1].update(name=7), "[1].name is 7: must be a valid string"),
        (lambda entries: entries[1].update(name="ANNA"), "anna and ANNA are one name"),
        (lambda entries: entries.append("carl"), "[2] is 'carl': must be a mapping"),
        *(
            (
                lambda entries, odd_name=name: entries[0].update(name=odd_name),
                "is not a user's name",
            )
            for name in CONFUSING
        ),
    ],
)
def test_broken_entry_is_told_with_its_number_and_why(file, change, text):
    entries = yaml.safe_load(file.read_text())
    change(entries)
    file.write_text(yaml.safe_dump(entries, sort_keys=False))
    with pytest.raises(InputError) as error:
        users.read(file)
    assert text in str(error.value)
    assert "\n" not in str(error.value)
    assert not re.search(r"\$argon2|\$scrypt", str(error.value))


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"\xff\xfe", "is no text in UTF-8"),
        (b"anna: operate", "must be a list of users"),
        (b"- name: anna\n role: [", "line 2, column"),
        (b"- {name: a, name: b}", "line 1, column 13: not valid YAML: key 'name' is given twice"),
        (b"[" * 5000, "not valid YAML"),
    ],
)
def test_file_that_is_no_list_of_users_is_told_in_a_line(file, content, text):
    file.write_bytes(content)
    with pytest.raises(ValueError, match="users_file") as error:
        users.read(file)
    assert text in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("password", "text"),
    [
        ("eleven char", "12 to 128"),
        ("x" * 129, "12 to 128"),
        ("line\nbreak and more", "control"),
        ("ANNA-maria-1", "name"),
    ],
)
def test_password_has_rules(password, text):
    with pytest.raises(InputError, match=text):
        new_user("anna-MARIA-1", password)


def test_password_is_checked():
    known = Users([new_user("Anna", PASSWORD)])
    for name, password in (
        ("Anna", "wrong"),
        ("Anna", ""),
        ("Bert", PASSWORD),
        ("Anna", PASSWORD + "\ud800"),
    ):
        assert known.check(name, password) == ""
    assert known.check("aNNa", PASSWORD) == "Anna"


def test_same_letters_in_another_encoding_are_the_same_password():
    known = Users([new_user("anna", "stra\u00dfe nach \u00c5rhus")])
    assert known.check("anna", "stra\u00dfe nach A\u030arhus") == "anna"


def test_hash_is_argon2id_as_rfc_9106_recommends_it():
    assert (HASHER.type, HASHER.time_cost, HASHER.memory_cost) == (Type.ID, 3, 65536)
    assert HASHER.parallelism == 1  # the thread that has stepped back takes no others along


def test_password_that_cannot_be_checked_for_want_of_memory_is_not_a_wrong_one(monkeypatch):
    def verify(*_):
        raise VerificationError("Memory allocation error")

    known = Users([new_user("anna", PASSWORD)])
    monkeypatch.setattr(users, "HASHER", SimpleNamespace(verify=verify))
    with pytest.raises(MemoryError):
        known.check("anna", PASSWORD)


def test_damaged_hash_knows_no_password():
    anna = new_user("anna", PASSWORD)
    damaged = anna.model_copy(update={"password": anna.password[:-1] + "!"})
    assert Users([damaged]).check("anna", PASSWORD) == ""


def test_unknown_name_costs_the_same_hash_as_a_known_one(monkeypatch):
    known, checked = Users([new_user("anna", PASSWORD)]), []
    genuine = users.HASHER

    def verify(hashed, given):
        checked.append(extract_parameters(hashed))
        return genuine.verify(hashed, given)

    monkeypatch.setattr(users, "HASHER", SimpleNamespace(verify=verify))
    assert [known.check(name, "wrong") for name in ("anna", "nobody")] == ["", ""]
    assert len(checked) == 2 and checked[0] == checked[1]


def test_file_stays_whole_when_it_cannot_be_written(file, monkeypatch):
    before = file.read_bytes()
    monkeypatch.setattr(
        "os.replace", lambda *_: (_ for _ in ()).throw(OSError(errno.ENOSPC, "disk full"))
    )
    with pytest.raises(OSError, match="disk full"):
        users.write(file, [])
    assert (file.read_bytes(), [path.name for path in file.parent.iterdir()]) == (
        before,
        ["users.yaml"],
    )
