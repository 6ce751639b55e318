"""``fsw`` and ``python -m fsw``: Ctrl-C while modules are loaded ends without a traceback."""

import os
import signal
import sys
from importlib import import_module


def _end(*_: object) -> None:
    os.write(2, b"interrupted\n")
    os._exit(130)


def main() -> int:
    """Run the command line; returns its exit code."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    run = import_module("fsw.main").main
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return int(run())


if __name__ == "__main__":
    sys.exit(main())
