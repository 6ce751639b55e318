"""The C library of the NMPC: sources in ``kernel/``, built as ``fsw_control.c_library`` says.

Run ``python -m fsw_nmpc.kernel_build`` to build it ahead.
"""

from __future__ import annotations

import sys
from pathlib import Path

from fsw_control.c_library import CLibrary, compiler

__all__ = ["FOLDER", "LIBRARY", "SOURCES", "build", "compiler", "ensure", "find", "is_usable", "source_id"]

LIBRARY = CLibrary("fsw_nmpc", Path(__file__).parent / "kernel", "fsw_controller_id")
FOLDER, SOURCES = LIBRARY.folder, LIBRARY.sources
source_id, is_usable, find = LIBRARY.source_id, LIBRARY.is_usable, LIBRARY.find
ensure, build = LIBRARY.ensure, LIBRARY.build

if __name__ == "__main__":
    sys.exit(LIBRARY.main())
