"""Users and their file of password hashes, or one token for all."""

from __future__ import annotations

import re
import secrets
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

import yaml
from argon2 import PasswordHasher, extract_parameters
from argon2.exceptions import VerificationError
from argon2.low_level import error_to_str
from pydantic import AfterValidator, TypeAdapter

from fsw_control.coded import RefusedError, Worded
from fsw_control.schema.files import read_private, write_whole
from fsw_control.schema.models import InputError, Many, Model, content_of, validate, validated_by

#: Only what looks different is different: no letters of other alphabets, no spaces; upper and
#: lower case are the same.
NAME_RULE = "ASCII letters, digits and . _ -, a letter or digit first, at most 32"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,31}")
#: of passwords and tokens
SHORTEST, LONGEST = 12, 128
_LONGEST_BYTES = 1_000_000
#: Argon2id with the library's time and memory (RFC 9106, second choice), in one thread: the one
#: that steps back
HASHER = PasswordHasher(parallelism=1)
_NO_MEMORY = error_to_str(-22)  # ARGON2_MEMORY_ALLOCATION_ERROR


class NameFlaw(Worded):
    """Why a text is no name of a user."""

    NOT_A_NAME = "{name!r} is not a user's name ({rule})"


def checked_name(name: str) -> str:
    """Return the name if it is unambiguous; else raises RefusedError."""
    if not _NAME.fullmatch(name):
        raise RefusedError.of(NameFlaw.NOT_A_NAME, name=name[:40], rule=NAME_RULE)
    return name


def _checked_hash(text: str) -> str:
    try:
        extract_parameters(text)
    except ValueError:
        raise ValueError(
            "is no hash of Argon2: delete the file and add its users again by "
            "'fsw.py hmi user add'"
        ) from None
    return text


class User(Model):
    """One user in the file."""

    name: Annotated[str, AfterValidator(checked_name)]
    password: Annotated[str, AfterValidator(_checked_hash)]
    """salted hash"""


_USERS = TypeAdapter(Many[User])


class Users:
    """Whoever may command: named users, or with a token everybody who knows it, by any name."""

    def __init__(self, users: Iterable[User] = (), token: str = "") -> None:
        self.kind = "token" if token else "password"  #: of what a user knows
        self._users = {user.name.casefold(): user for user in users}
        # a password for unknown names, whose check takes as long
        self._other = HASHER.hash(_bytes(token or secrets.token_urlsafe()))

    def name(self, name: str) -> str:
        """Spelling of a user's name in the file; empty for an unknown user."""
        user = self._users.get(name.casefold())
        return user.name if user else ""

    def check(self, name: str, password: str) -> str:
        """Name of the user of a name and password, empty if one is wrong; slow, thread-safe.

        Raises
        ------
        MemoryError
            When there is too little memory for the hash.
        """
        user = self._users.get(name.casefold())
        try:
            HASHER.verify(user.password if user else self._other, _bytes(password))
        except VerificationError as error:  # without a code of its own
            if str(error) == _NO_MEMORY:
                raise MemoryError(_NO_MEMORY) from None
            return ""
        return user.name if user else name if self.kind == "token" else ""


def of(users_file: str, token_file: str) -> tuple[Users, str]:
    """Users in a file, or who knows the token in a file or a new one, which is returned, too.

    Raises
    ------
    ValueError
        When both files are given, one cannot be used, or there is no user.
    """
    if users_file and token_file:
        raise ValueError("users_file, token_file: give one of them")
    if users_file:
        path = Path(users_file).expanduser()
        if users := read(path):
            return Users(users), ""
        raise InputError(f"users_file: {path} has no user: add one with 'fsw.py hmi user add'")
    if token_file:
        return Users(token=read_token(Path(token_file).expanduser())), ""
    token = secrets.token_urlsafe(12)
    return Users(token=token), token


def new_user(name: str, password: str) -> User:
    """A user with a password.

    Raises
    ------
    InputError
        When the name may be confused with another, or the password is too short, too long or the
        name.
    """
    if not SHORTEST <= len(password) <= LONGEST or not password.isprintable():
        raise InputError(
            f"the password must have {SHORTEST} to {LONGEST} characters, "
            "none of them a control character"
        )
    if password.casefold() == name.casefold():
        raise InputError("the password must not be the name")
    hashed = HASHER.hash(_bytes(password))
    return validate(User, {"name": name, "password": hashed}, "user")


def read_token(path: Path) -> str:
    """The token in a file.

    Raises
    ------
    ValueError
        When the file cannot be read or is empty, or others may read or change the file; the
        message says what to do.
    """
    try:
        token = read_private("token_file", path, 4096).decode().strip()
    except UnicodeDecodeError:
        raise ValueError(f"token_file: {path} is no text") from None
    if not SHORTEST <= len(token) <= LONGEST or "\n" in token:
        raise ValueError(
            f"token_file: {path} must hold one line of {SHORTEST} to {LONGEST} characters"
        )
    return token


def read(path: Path) -> list[User]:
    """The users in a file.

    Raises
    ------
    ValueError
        When the file cannot be read, others may read or change it, or an entry is wrong; the
        message says which and why.
    """
    where = f"users_file: {path}"
    try:
        text = read_private("users_file", path, _LONGEST_BYTES).decode()
    except UnicodeDecodeError:
        raise InputError(f"{where} is no text in UTF-8") from None
    content = content_of(text, where)
    if content is not None and not isinstance(content, list):  # it may hold a password
        raise InputError(f"{where}: must be a list of users with name and password")
    users = validated_by(_USERS.validate_python, content or [], where)
    names = Counter(user.name.casefold() for user in users)
    if twice := [user.name for user in users if names[user.name.casefold()] > 1]:
        raise InputError(f"{where}: {' and '.join(twice)} are one name (case does not count)")
    return list(users)


def write(path: Path, users: Sequence[User]) -> None:
    """Write the file atomically, readable only by its owner."""
    style: dict[str, Any] = {"sort_keys": False, "default_flow_style": None, "width": 1000}
    lines = (yaml.safe_dump([user.model_dump()], **style) for user in users)
    write_whole(path, "".join(lines), 0o600, durable=True)


def _bytes(password: str) -> bytes:
    """Bytes of the normalised text, since the same letters have several encodings."""
    return unicodedata.normalize("NFC", password).encode("utf-8", "surrogatepass")
