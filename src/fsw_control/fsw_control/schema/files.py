"""Bounded reading of users' files, the cache folder, new, private and status files."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import chain, count
from pathlib import Path
from typing import Any, BinaryIO

#: largest file that is read at once; as JSON that is at most some 400 MB in memory
LONGEST_BYTES = 16 * 2**20
#: environment variable with the file's path, set by the parent
VARIABLE = "FSW_STATUS_FILE"


def write_status(**values: Any) -> None:
    """Replace the status, if the parent process has named a file."""
    path = os.environ.get(VARIABLE)
    if path is None:
        return
    with suppress(OSError):  # a full disk must not end the weld
        write_whole(Path(path), json.dumps(values))


def read_status(path: Path) -> dict[str, Any]:
    """Return the last status; empty before the first one."""
    try:
        status: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    return status


def read_private(name: str, path: Path, longest_bytes: int = -1) -> bytes:
    """Read a secret file, at most ``longest_bytes``; ``name`` is the setting for messages.

    Raises
    ------
    ValueError
        If it cannot be read, or others can read or change it; the message gives the remedy.
    """
    try:
        with open_regular(path) as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            content = file.read(longest_bytes)
    except OSError as error:
        raise ValueError(f"{name}: cannot read {path}: {error.strerror}") from None
    if mode & 0o077:
        raise ValueError(f"{name}: others may read {path} (mode {mode:03o}): chmod 600 {path}")
    return content


def free_sibling(folder: Path) -> Path:
    """The folder if it does not exist, else the first free ``<name>_1``, ``<name>_2``, ..."""
    siblings = (folder.with_name(f"{folder.name}_{number}") for number in count(1))
    return next(path for path in chain([folder], siblings) if not os.path.lexists(path))


def set_aside(folder: Path) -> Path:
    """Rename a folder (of a link: its target) to the first free ``<name>_1``, ...; returns that.

    Raises
    ------
    OSError
        If that is not possible, also if the current folder is in it; ``strerror`` says why.
    """
    folder = folder.resolve()
    if Path.cwd().is_relative_to(folder):
        raise OSError(errno.EBUSY, "the current folder is in it; choose another", str(folder))
    return folder.rename(free_sibling(folder))


def open_regular(path: str | Path) -> BinaryIO:
    """Open a regular file for reading; never blocks, for example on the other end of a pipe.

    Raises
    ------
    OSError
        If it cannot be opened, or is not a regular file; ``strerror`` gives the remedy.
    """
    mode = os.stat(path).st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # opening it would already act on it
        text = "not a regular file; save its content in a file and give that"
        raise OSError(errno.EINVAL, text, str(path))
    return open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK))


def read_regular(path: str | Path, longest_bytes: int = LONGEST_BYTES) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    OSError
        As in :func:`open_regular`, or if it is longer than ``longest_bytes``.
    """
    with open_regular(path) as file:
        size_bytes = os.fstat(file.fileno()).st_size
        content = file.read(longest_bytes + 1) if size_bytes <= longest_bytes else b""
    if max(size_bytes, len(content)) > longest_bytes:
        text = f"larger than {longest_bytes} bytes; give a smaller file"
        raise OSError(errno.EINVAL, text, str(path))
    return content


def user_cache(name: str) -> Path:
    """Folder of a package in the user's cache, by the XDG Base Directory Specification.

    Made if it is missing; see :func:`writable`.
    """
    cache = os.environ.get("XDG_CACHE_HOME", "")
    home = Path(cache) if os.path.isabs(cache) else Path("~/.cache")
    return writable(home / name, name)


def writable(folder: Path, name: str) -> Path:
    """Return a folder, made if it is missing, or where it cannot be written a private one.

    That is the case in containers and sandboxes. The private one, called ``name``, is in the
    temporary folder, in a folder where only this user may write.

    Raises
    ------
    OSError
        If that cannot be made, or belongs to another user.
    """
    with suppress(OSError, RuntimeError):  # RuntimeError: there is no home folder
        folder = folder.expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK | os.X_OK):
            return folder
    own = Path(tempfile.gettempdir()) / f"fsw-{os.getuid()}"
    own.mkdir(mode=0o700, exist_ok=True)
    # Libraries are loaded from there: neither a link nor a folder of somebody else will do.
    state = own.lstat()
    if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.getuid() or state.st_mode & 0o077:
        raise PermissionError(errno.EACCES, "not private; set XDG_CACHE_HOME", str(own))
    folder = own / name
    folder.mkdir(exist_ok=True)
    return folder


@contextmanager
def replacing(path: Path, mode: int = 0o666) -> Iterator[Path]:
    """Yield a new file beside ``path`` that replaces it at the end, or is removed after an error.

    Nobody ever reads half a file, and several processes may write it at once. It has the suffix
    of ``path``. Links are followed; anything but a file, such as ``/dev/stdout``, is never
    replaced but written directly. The new file has the ``mode``, less the umask.

    Raises
    ------
    OSError
        If the file cannot be created, written or replaced; the error names ``path``.
    """
    if path.exists() and not path.is_file():
        yield path
        return
    target = path.resolve()
    scratch = target.with_name(f".{path.stem}.{secrets.token_hex(4)}.tmp{path.suffix}")
    try:
        os.close(os.open(scratch, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))
        yield scratch
        scratch.replace(target)
    except OSError as error:
        if error.filename in (None, str(scratch)):  # a write does not say where
            error.filename, error.filename2 = str(path), None
        raise
    finally:
        scratch.unlink(missing_ok=True)


def write_whole(
    path: Path, content: str | bytes, mode: int = 0o666, durable: bool = False
) -> None:
    """Write a file as :func:`replacing` does, text in UTF-8; ``durable``: synced to disk first.

    Raises
    ------
    OSError
        As in :func:`replacing`.
    """
    with replacing(path, mode) as scratch, scratch.open("wb") as file:
        file.write(content.encode() if isinstance(content, str) else content)
        if durable:
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder, created if necessary, for one process at a time; others wait.

    Raises
    ------
    OSError
        If the folder cannot be created or opened.
    """
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
