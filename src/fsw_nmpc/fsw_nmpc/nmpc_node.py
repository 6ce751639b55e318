"""The NMPC as a node."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from typing import Any

# The matrices are far too small to be shared among threads; must be set before numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from rclpy.logging import get_logger

from fsw_control import run_controller
from fsw_nmpc import NmpcController


def _make(values: Mapping[str, Any]) -> NmpcController:
    logger = get_logger("fsw_nmpc")
    return NmpcController(values, logger.info, logger.error)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_controller(_make, name=NmpcController.name, parameters=NmpcController.parameters, args=args)


if __name__ == "__main__":
    sys.exit(main())
