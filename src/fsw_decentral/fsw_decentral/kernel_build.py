"""The C library of the decentralized controller: sources in ``kernel/``, built as ``fsw_control.c_library`` says.

Run ``python -m fsw_decentral.kernel_build`` to build it ahead.
"""

from __future__ import annotations

import sys
from pathlib import Path

from fsw_control.c_library import CLibrary

LIBRARY = CLibrary("fsw_decentral", Path(__file__).parent / "kernel", "fsw_decentral_id")

if __name__ == "__main__":
    sys.exit(LIBRARY.main())
