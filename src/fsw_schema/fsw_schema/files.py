"""Files that this software keeps for a user: where what can be made anew is, and how a file appears whole."""

from __future__ import annotations

import fcntl
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def user_cache(name: str) -> Path:
    """Folder of a package in the user's cache, after the XDG Base Directory Specification.

    Raises
    ------
    RuntimeError
        There is no home folder.
    """
    cache = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(cache) if os.path.isabs(cache) else Path.home() / ".cache") / name


@contextmanager
def replacing(path: Path, mode: int = 0o666) -> Iterator[Path]:
    """A new, empty file beside ``path`` to be written, which takes its place at the end, or is removed after an error.

    So nobody ever reads half a file, and several processes may write it at once. It has the suffix of ``path``.
    A link is followed; what is no file, as ``/dev/stdout``, is never replaced but written itself. The new file has the
    ``mode``, less the umask.

    Raises
    ------
    OSError
        The file cannot be made, written or replaced; it names ``path``.
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


def write_whole(path: Path, content: str | bytes, mode: int = 0o666, durable: bool = False) -> None:
    """Write a file as :func:`replacing` does, text in UTF-8; ``durable``: it is on the disk before it takes its place.

    Raises
    ------
    OSError
        As of :func:`replacing`.
    """
    with replacing(path, mode) as scratch, scratch.open("wb") as file:
        file.write(content.encode() if isinstance(content, str) else content)
        if durable:
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """One process at a time works in a folder, which is made if need be; others wait.

    Raises
    ------
    OSError
        The folder cannot be made or opened.
    """
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
