"""The file of named users, and the check of their passwords."""

import errno
import json

import pytest
import yaml

from fsw_control.schema.models import InputError
from fsw_hmi import users
from fsw_hmi.control_room import ControlRoom
from fsw_hmi.users import Users, UsersFile, new_user

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


def user(name="anna", role="operate", password=PASSWORD):
    """A user whose hash costs nothing."""
    return new_user(name, role, password, log2_n=1)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "users.yaml"
    users.write(path, [user("anna"), user("Bert.2", "engineer")])
    return path


def test_file_is_private_holds_no_password_and_is_read_as_written(file):
    assert file.stat().st_mode & 0o777 == 0o600
    assert PASSWORD not in file.read_text()
    assert [(one.name, one.role) for one in users.read(file)] == [
        ("anna", "operate"),
        ("Bert.2", "engineer"),
    ]
    assert len({one.password for one in users.read(file)}) == 2  # each has its own salt


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o602])
def test_file_that_others_may_read_is_refused(file, mode):
    file.chmod(mode)
    with pytest.raises(ValueError, match=f"others may read {file} .*chmod 600"):
        users.read(file)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            lambda entries: entries[1].update(role="boss"),
            "[1].role is 'boss'; one of view, operate or engineer",
        ),
        (lambda entries: entries[1].pop("role"), "[1] lacks role"),
        (
            lambda entries: entries[1].update(rank=1),
            "[1].rank is an unknown key; known: name, role, password",
        ),
        (
            lambda entries: entries[0].update(password="secret"),
            "[0].password is no hash of scrypt",
        ),
        (
            lambda entries: entries[0].update(
                password="$scrypt$ln=60,r=8,p=5$" + "A" * 22 + "$" + "A" * 43
            ),
            "no hash",
        ),
        (
            lambda entries: entries[0].update(
                password="$scrypt$ln=0,r=8,p=0$" + "A" * 22 + "$" + "A" * 43
            ),
            "no hash",
        ),
        (lambda entries: entries[1].update(name=7), "[1].name is 7, not text"),
        (lambda entries: entries[1].update(name="ANNA"), "anna and ANNA are one name"),
        (lambda entries: entries.append("carl"), "[2] is 'carl', not a mapping"),
        *(
            (lambda entries, one=name: entries[0].update(name=one), "is not a user's name")
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
    assert "$scrypt$ln=1," not in str(error.value)


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
        new_user("anna-MARIA-1", "view", password, log2_n=1)


def test_password_is_checked_and_remembered(monkeypatch):
    known = Users([user("Anna")])
    assert known.remembered("Anna", PASSWORD) is None
    for name, password in (
        ("Anna", "wrong"),
        ("Anna", ""),
        ("Bert", PASSWORD),
        ("Anna", PASSWORD + "\ud800"),
    ):
        assert known.check(name, password) is None
        assert known.remembered(name, password) is None
    assert known.check("aNNa", PASSWORD).name == "Anna"
    monkeypatch.setattr(users, "_scrypt", None)  # no hashing from now on
    assert known.remembered("anna", PASSWORD).name == "Anna"
    assert known.remembered("anna", "wrong") is None


def test_same_letters_in_another_encoding_are_the_same_password():
    known = Users([user(password="stra\u00dfe nach \u00c5rhus")])
    assert known.check("anna", "stra\u00dfe nach A\u030arhus") is not None


def test_unknown_name_takes_as_long_as_a_known_one(monkeypatch):
    costs = []
    genuine = users._scrypt
    monkeypatch.setattr(
        users,
        "_scrypt",
        lambda *given: costs.append(given[2:]) or genuine(given[0], given[1], 1),
    )
    known = Users([new_user("anna", "view", PASSWORD)])
    costs.clear()
    known.check("anna", "wrong")
    known.check("nobody", "wrong")
    assert costs == [(14,)] * 2


def test_file_stays_whole_when_it_cannot_be_written(file, monkeypatch):
    before = file.read_bytes()
    monkeypatch.setattr(
        "os.replace", lambda *_: (_ for _ in ()).throw(OSError(errno.ENOSPC, "disk full"))
    )
    with pytest.raises(OSError, match="disk full"):
        users.write(file, [])
    assert (file.read_bytes(), [one.name for one in file.parent.iterdir()]) == (
        before,
        ["users.yaml"],
    )


@pytest.fixture
def told():
    return []


def changed(file, *entries):
    """Write the file anew, as ``fsw.py hmi user`` does."""
    users.write(file, entries)


def test_file_is_read_again_when_it_has_changed(file, told):
    found = UsersFile(file, told.append)
    assert found.look() == frozenset()
    anna = users.read(file)[0]
    assert found.check("anna", PASSWORD) is not None
    changed(file, anna, user("carl"))
    assert found.look() == {"bert.2"}
    assert (found.check("bert.2", PASSWORD), found.check("Carl", PASSWORD).role) == (
        None,
        "operate",
    )
    assert found.remembered("anna", PASSWORD) is not None, "who has not been changed is known"
    changed(file, user("anna", password="another password"), user("carl"))
    assert found.look() == {"anna", "carl"}
    assert (found.remembered("anna", PASSWORD), found.check("anna", PASSWORD)) == (None, None)
    assert found.check("anna", "another password") is not None
    assert told == []


@pytest.mark.parametrize("broken", ["- {name: anna}\n", "", "nonsense: [", None])
def test_broken_file_leaves_the_last_good_users_and_is_told_once(file, told, broken):
    found = UsersFile(file, told.append)
    good = file.read_text()
    file.unlink() if broken is None else file.write_text(broken)
    for _ in range(3):
        assert found.look() == frozenset()
    assert found.check("anna", PASSWORD) is not None
    (line,) = told
    assert (
        str(file) in line and line.endswith("; the users before still hold") and "\n" not in line
    )
    file.write_text(good)
    file.chmod(0o600)
    assert (found.look(), told) == (frozenset(), [line])


def test_user_who_is_changed_loses_control_and_may_still_stop(file, told):
    room = ControlRoom(UsersFile(file, told.append))
    session, other = room.join("192.0.2.4"), room.join("192.0.2.4")

    def ask(page, do, **content):
        return room.handle(page, json.dumps({"id": 1, "do": do, **content}), 1.0)

    for page, name in ((session, "anna"), (other, "Bert.2")):
        verdict = ask(page, "login", name=name, password=PASSWORD)
        room.on_checked(page, verdict.credentials, room.check(*verdict.credentials), 1.0)
    ask(session, "take_control", **{"from": None})
    changed(file, user("anna", "view"), users.read(file)[1])
    room.tick(1.0)
    assert room.holder is None
    assert room.control(session, 1.0)["note_code"] == "shut"
    assert ask(session, "mode", mode="hold").answer.message == "log in again"
    assert ask(session, "safe_stop").action is not None
    assert ask(other, "take_control", **{"from": None}).answer.outcome == "done"
    changed(file, user("dora"))
    again = ask(
        session, "login", name="Bert.2", password=PASSWORD
    )  # looked at before the next tick, too
    assert again.credentials is not None and room.check(*again.credentials) is None
    assert room.holder is None
