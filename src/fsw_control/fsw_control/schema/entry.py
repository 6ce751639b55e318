"""Entry points of programs with a slow import, which Ctrl-C or SIGTERM can end quietly.

Every name of this module stands for a package: ``fsw_control.schema.entry:fsw_hmi.main.main`` is
an entry point that imports ``fsw_hmi.main`` when it is called and then calls its ``main``. Neither
this module nor ``fsw_control`` imports anything slow.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def quiet_start() -> Iterator[None]:
    """End the process at once with exit code 0 on SIGINT and SIGTERM during slow imports."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [signal.signal(sign, lambda *_: os._exit(0)) for sign in _SIGNALS]
    try:
        yield
    finally:
        for sign, handler in zip(_SIGNALS, before, strict=True):
            signal.signal(sign, handler)


class Program:
    """A function given by its dotted path, imported when it is called."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __getattr__(self, name: str) -> Program:
        if name.startswith("__"):
            raise AttributeError(name)
        return Program(f"{self._path}.{name}")

    def __call__(self) -> int:
        """Import and call it; returns its exit code, 0 if it is interrupted before it begins."""
        module, _, function = self._path.rpartition(".")
        try:
            with quiet_start():
                program = getattr(import_module(module), function)
            return int(program() or 0)
        except KeyboardInterrupt:
            # between the imports and what takes care of signals from then on
            for sign in _SIGNALS:
                signal.signal(sign, signal.SIG_IGN)
            return 0


def __getattr__(name: str) -> Program:
    if name.startswith("__"):
        raise AttributeError(name)
    return Program(name)
