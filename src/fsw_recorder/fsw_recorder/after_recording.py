"""Runs commands on a finished bag, in a process that outlives the recorder and spares the bag."""

from __future__ import annotations

import fcntl
import os
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from fsw_recorder.errors import BagError

LOG_NAME = "on_finished.log"
#: placeholder for the bag's folder in a command
BAG = "{bag}"
#: they yield to everything else on the machine
_NICENESS = 10
#: environment variable of the commands: they do not wait for themselves
_WITHIN = "FSW_AFTER_RECORDING"


def check(commands: Sequence[str]) -> None:
    """Reject commands that cannot be split into words, by a `BagError`."""
    for command in commands:
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise BagError(f"on_finished '{command}': {error}") from None
        if not words:
            raise BagError("on_finished: a command is empty")


def start(commands: Sequence[str], folder: Path) -> subprocess.Popen[bytes]:
    """Start the commands without waiting; signals to the recorder or its terminal miss them.

    Raises
    ------
    OSError
        If no process can be started.
    """
    words = [sys.executable, "-m", "fsw_recorder.after_recording", str(folder), *commands]
    path = os.pathsep.join(path for path in sys.path if path)
    environment = {**os.environ, "PYTHONPATH": path, _WITHIN: str(folder)}
    lock = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # network file systems may not support locks
            fcntl.flock(lock, fcntl.LOCK_EX)  # held until the inheriting process ends
        return subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            env=environment,
            pass_fds=[lock],
        )
    finally:
        os.close(lock)


def wait(folder: Path, say: Callable[[str], object]) -> None:
    """Wait until the commands of a bag have ended; ``say`` gets a message if that takes time.

    It does not wait for commands of a recorder on another computer, nor within such a command.
    """
    if _WITHIN in os.environ or not folder.is_dir() or not os.access(folder, os.R_OK):
        return
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        say(f"waiting for what the recorder runs with the finished bag; see {folder / LOG_NAME}")
        fcntl.flock(lock, fcntl.LOCK_SH)
    except OSError:  # locks are not supported here
        pass
    finally:
        os.close(lock)


def run(commands: Sequence[str], folder: Path) -> str:
    """Run the commands in sequence until one fails; their output goes to ``on_finished.log``.

    Returns
    -------
    str
        Why one failed, in one line; empty if none did.
    """
    log = folder / LOG_NAME
    for command in commands:
        words = [word.replace(BAG, str(folder)) for word in shlex.split(command)]
        try:
            done = subprocess.run(
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                check=False,
            )
            code, output = f"exit code {done.returncode}", done.stdout.decode(errors="replace")
            failed = done.returncode != 0
        except (OSError, ValueError) as error:
            code, output, failed = "not started", str(error), True
        with (
            suppress(OSError),
            log.open("a", encoding="utf-8") as file,
        ):  # the bag may have been moved
            file.write(f"$ {shlex.join(words)}\n{output}{code}\n")
        if failed:
            last = " ".join((output.strip().splitlines() or ["it printed nothing"])[-1].split())
            return (
                f"on_finished: {words[0]} failed ({code}): {last}; the bag is unharmed, see {log}"
            )
    return ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the commands; exit code 1 with one line on stderr if one failed."""
    folder, *commands = sys.argv[1:] if arguments is None else arguments
    os.nice(_NICENESS)
    if failure := run(commands, Path(folder)):
        with suppress(OSError):  # the process that started the recorder may have ended
            print(failure, file=sys.stderr, flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
