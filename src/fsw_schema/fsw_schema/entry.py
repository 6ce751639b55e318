"""Entry points of programs that take long to import: Ctrl-C meanwhile ends them without a traceback.

Every name of this module stands for a package: ``fsw_schema.entry:fsw_plant.plant_node.main`` is an entry point that
imports ``fsw_plant.plant_node`` when it is called and then calls its ``main``. This package imports next to nothing.
"""

from __future__ import annotations

import os
import signal
import threading
from importlib import import_module


class Program:
    """A function by its dotted path, which is imported when it is called."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __getattr__(self, name: str) -> Program:
        if name.startswith("__"):
            raise AttributeError(name)
        return Program(f"{self._path}.{name}")

    def __call__(self) -> int:
        """Import and call it; returns its exit code, 0 when it is interrupted before it begins."""
        module, _, function = self._path.rpartition(".")
        replace = threading.current_thread() is threading.main_thread()
        before = signal.signal(signal.SIGINT, lambda *_: os._exit(0)) if replace else None
        try:
            program = getattr(import_module(module), function)
        finally:
            if replace:
                signal.signal(signal.SIGINT, before)
        return int(program() or 0)


def __getattr__(name: str) -> Program:
    if name.startswith("__"):
        raise AttributeError(name)
    return Program(name)
