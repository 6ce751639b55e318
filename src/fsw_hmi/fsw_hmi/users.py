"""Users and their file of salted password hashes, or one token for all."""

from __future__ import annotations

import base64
import hashlib
import hmac
import re
import secrets
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Sequence, Set
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, TypeAdapter

from fsw_control.coded import RefusedError, Worded
from fsw_control.schema.files import read_private, write_whole
from fsw_control.schema.models import InputError, Many, Model, content_of, validate, validated_by

#: each role includes those before it
ROLES = ("view", "operate", "engineer")
Role = Literal["view", "operate", "engineer"]
#: Only what looks different is different: no letters of other alphabets, no spaces; upper and
#: lower case are the same.
NAME_RULE = "ASCII letters, digits and . _ -, a letter or digit first, at most 32"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,31}")
#: of passwords and tokens: 12 random digits last 15 years at 1000 trials a second
SHORTEST, LONGEST = 12, 128
_LONGEST_BYTES = 1_000_000
#: cost of scrypt as OWASP recommends it for 16 MiB: 2^14 blocks of 8 * 128 bytes, five times
_LOG2_N, _R, _P = 14, 8, 5
#: at most 128 MiB
_HASH = re.compile(
    rf"\$scrypt\$ln=([1-9]|1[0-7]),r={_R},p={_P}\$([A-Za-z0-9+/]{{22}})\$([A-Za-z0-9+/]{{43}})"
)


class NameFlaw(Worded):
    """Why a text is no name of a user."""

    NOT_A_NAME = "not_a_name", "{name!r} is not a user's name ({rule})"


def checked_name(name: str) -> str:
    """Return the name if it is unambiguous; else raises RefusedError."""
    if not _NAME.fullmatch(name):
        raise RefusedError.of(NameFlaw.NOT_A_NAME, name=name[:40], rule=NAME_RULE)
    return name


def _checked_hash(text: str) -> str:
    if not _HASH.fullmatch(text):
        raise ValueError("is no hash of scrypt as 'fsw.py hmi user' writes it")
    return text


class User(Model):
    """One user in the file."""

    name: Annotated[str, AfterValidator(checked_name)]
    role: Role
    password: Annotated[str, AfterValidator(_checked_hash)]
    """salted hash"""


_USERS = TypeAdapter(Many[User])


class Users:
    """All users. A correct password is cached, so that it is hashed only once."""

    kind = "password"  #: of what a user knows
    new = ""  #: a token that was made for this run, to be printed

    def __init__(self, users: Iterable[User]) -> None:
        self._users = _by_name(users)
        self._key = secrets.token_bytes(32)
        self._known: dict[str, bytes] = {}

    def look(self) -> Set[str]:
        """Look for changes; returns the names of users that were changed or removed."""
        return frozenset()

    def name(self, name: str) -> str:
        """Spelling of a user's name in the file; empty for an unknown user."""
        user = self._users.get(name.casefold())
        return user.name if user else ""

    def remembered(self, name: str, password: str) -> User | None:
        """User who has given this name and password before; fast."""
        known = self._known.get(name.casefold())
        right = known is not None and hmac.compare_digest(known, self._mark(name, password))
        return self._users.get(name.casefold()) if right else None

    def check(self, name: str, password: str) -> User | None:
        """User of a name and password; slow, equally so for unknown names, and thread-safe."""
        user = self.remembered(name, password)
        if user is not None:
            return user
        user = self._users.get(name.casefold())
        if not _fits(user.password if user else _NOBODY, password) or user is None:
            return None
        self._known[name.casefold()] = self._mark(name, password)
        return user

    def _mark(self, name: str, password: str) -> bytes:
        return hmac.digest(
            self._key, name.casefold().encode() + b"\0" + _bytes(password), "sha256"
        )


class Token(Users):
    """A token for all: whoever knows it is an engineer, by any name."""

    kind = "token"

    def __init__(self, token: str) -> None:
        if not token:
            raise ValueError("the token is empty")
        super().__init__(())
        self._token = _bytes(token)

    def remembered(self, name: str, password: str) -> User | None:
        """See :meth:`Users.remembered`; a token needs no hash, so it is always checked here."""
        right = hmac.compare_digest(_bytes(password), self._token)
        return User.model_construct(name=name, role=ROLES[-1]) if right else None


class UsersFile(Users):
    """Users in a file that is read again after a change; an invalid file is ignored.

    ``warn`` gets a line, once for each change, that says why the file cannot be used.

    Raises
    ------
    ValueError
        As :func:`read`, or there is no user.
    """

    def __init__(self, path: Path, warn: Callable[[str], object]) -> None:
        self._path, self._warn = path, warn
        self._version = self._found()
        super().__init__(self._read())

    def look(self) -> Set[str]:
        """See :meth:`Users.look`; reads the file again if it has changed."""
        version = self._found()
        if version == self._version:
            return frozenset()
        self._version = version
        try:
            users = _by_name(self._read())
        except ValueError as error:
            self._warn(f"{error}; the users before still hold")
            return frozenset()
        before, self._users = self._users, users
        changed = frozenset(name for name, user in before.items() if users.get(name) != user)
        self._known = {name: mark for name, mark in self._known.items() if name not in changed}
        return changed

    def _read(self) -> list[User]:
        users = read(self._path)
        if not users:
            raise InputError(
                f"users_file: {self._path} has no user: add one with 'fsw.py hmi user add'"
            )
        return users

    def _found(self) -> tuple[int, ...] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino


def _by_name(users: Iterable[User]) -> dict[str, User]:
    return {user.name.casefold(): user for user in users}


def of(users_file: str, token_file: str, warn: Callable[[str], object]) -> Users:
    """Whoever may command: users in a file, or who knows the token in a file or a new one."""
    if users_file and token_file:
        raise ValueError("users_file, token_file: give one of them")
    if users_file:
        return UsersFile(Path(users_file).expanduser(), warn)
    if token_file:
        return Token(read_token(Path(token_file).expanduser()))
    made = Token(token := new_token())
    made.new = token
    return made


def new_user(name: str, role: Role, password: str, log2_n: int = _LOG2_N) -> User:
    """A user with a password.

    Raises
    ------
    InputError
        When the name may be confused with another, or the password is too short, too long or the
        name.
    """
    if not SHORTEST <= len(password) <= LONGEST or not password.isprintable():
        raise InputError(
            f"the password must have {SHORTEST} to {LONGEST} characters, none of them a control character"
        )
    if password.casefold() == name.casefold():
        raise InputError("the password must not be the name")
    salt = secrets.token_bytes(16)
    hashed = _hash(log2_n, salt, _scrypt(password, salt, log2_n))
    return validate(User, {"name": name, "role": role, "password": hashed}, "user")


def new_token() -> str:
    """A token for one run."""
    return secrets.token_urlsafe(12)


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
    if len(token) < SHORTEST or "\n" in token:
        raise ValueError(
            f"token_file: {path} must hold one line of at least {SHORTEST} characters"
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
        raise InputError(f"{where}: must be a list of users with name, role and password")
    users = validated_by(_USERS.validate_python, content or [], where)
    names = Counter(user.name.casefold() for user in users)
    if twice := [user.name for user in users if names[user.name.casefold()] > 1]:
        raise InputError(f"{where}: {' and '.join(twice)} are one name (case does not count)")
    return list(users)


def write(path: Path, users: Sequence[User]) -> None:
    """Write the file atomically, readable only by its owner."""
    style: dict[str, Any] = {"sort_keys": False, "default_flow_style": None, "width": 1000}
    lines = (yaml.safe_dump([one.model_dump()], **style) for one in users)
    write_whole(path, "".join(lines), 0o600, durable=True)


def _bytes(password: str) -> bytes:
    """Bytes of the normalised text, since the same letters have several encodings."""
    return unicodedata.normalize("NFC", password).encode("utf-8", "surrogatepass")


def _scrypt(password: str, salt: bytes, log2_n: int) -> bytes:
    given, n = _bytes(password), 2**log2_n
    return hashlib.scrypt(given, salt=salt, n=n, r=_R, p=_P, maxmem=2**28, dklen=32)


def _hash(log2_n: int, salt: bytes, digest: bytes) -> str:
    salt_text, digest_text = (base64.b64encode(one).decode().rstrip("=") for one in (salt, digest))
    return f"$scrypt$ln={log2_n},r={_R},p={_P}${salt_text}${digest_text}"


def _fits(hashed: str, password: str) -> bool:
    found = _HASH.fullmatch(hashed)
    assert found is not None
    digest = _scrypt(password, base64.b64decode(found[2] + "=="), int(found[1]))
    return hmac.compare_digest(digest, base64.b64decode(found[3] + "="))


#: hash of no password, against which those of unknown names are checked
_NOBODY = _hash(_LOG2_N, bytes(16), secrets.token_bytes(32))
