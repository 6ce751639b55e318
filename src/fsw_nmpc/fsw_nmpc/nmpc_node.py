"""The NMPC as a node."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

# The matrices are too small to be shared among threads; must be set before numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from fsw_control import run_controller
from fsw_nmpc import NmpcController


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_controller(NmpcController, args=args)


if __name__ == "__main__":
    sys.exit(main())
