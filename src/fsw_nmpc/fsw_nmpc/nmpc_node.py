"""The NMPC as a node."""

import sys
from collections.abc import Sequence

from fsw_control import run_controller
from fsw_nmpc import NmpcController


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_controller(NmpcController, args=args)


if __name__ == "__main__":
    sys.exit(main())
