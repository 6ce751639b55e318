"""Errors that a command shows in one line, and the resulting exit code."""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from fsw_control.free_domain import NoFreeDomainError
from fsw_control.schema.errors import InputError
from fsw_recorder.errors import BagError
from fsw_scenario.launcher import LaunchError

#: documentation of the installation of ROS 2
HOW = "see docs/how-to/install.md"


def middleware_is_here() -> bool:
    """Whether rclpy and this project's messages are installed."""
    return (
        all(find_spec(name) is not None for name in ("rclpy", "fsw_msgs"))
        and find_spec("fsw_msgs.msg") is not None
    )


class CommandError(Exception):
    """A command cannot be run; the text says what, where and what to do."""


SHOWN = (CommandError, InputError, BagError, LaunchError, NoFreeDomainError)


def program() -> str:
    """Program name: ``fsw`` if the package is installed, ``fsw.py`` in the repository."""
    return "fsw" if Path(sys.argv[0]).name == "fsw" else "fsw.py"


def _said(error: BaseException) -> str:
    """Text of an error in one line; commands in it get the program name typed by the user."""
    return " ".join(str(error).split()).replace("fsw.py ", f"{program()} ")


def _without_ros(error: BaseException) -> str:
    """Words for a missing module of ROS 2, also where an entry point needed it; else empty."""
    missing = error if isinstance(error, ModuleNotFoundError) else error.__cause__
    if not isinstance(missing, ModuleNotFoundError):
        return ""
    return f"needs ROS 2, which is not installed ({missing}): {HOW}"


@contextmanager
def _termination_as_ctrl_c() -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt, so that partial files are removed, unless ignored."""
    in_main_thread = threading.current_thread() is threading.main_thread()
    if not in_main_thread or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def exit_code(action: Callable[[], int]) -> int:
    """Run a command; returns 0, 1 on an expected error (printed in one line), 130 on interrupt."""
    try:
        with _termination_as_ctrl_c():
            code = action()
        if sys.stdout is not None:  # closed by the parent process
            sys.stdout.flush()
        return code
    except (*SHOWN, ModuleNotFoundError) as error:
        text = _without_ros(error) if not middleware_is_here() else ""
        if not text and isinstance(error, ModuleNotFoundError):
            raise
        print(f"error: {text or _said(error)}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        print(f"interrupted{f': {_said(interrupt)}' if interrupt.args else ''}", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # the reader of the output has ended: do not flush at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:  # an unreadable or unwritable file, wherever it occurs
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        where = "writing failed: " if full else ""  # to standard output, if no file is named
        where = f"cannot read or write {error.filename}: " if error.filename else where
        print(f"error: {where}{error.strerror or error}", file=sys.stderr)
        return 1
