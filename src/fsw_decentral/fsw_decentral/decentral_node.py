"""The decentralized controller as a node."""

import sys
from collections.abc import Sequence

from fsw_control import run_controller
from fsw_decentral import DecentralController


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_controller(DecentralController, args=args)


if __name__ == "__main__":
    sys.exit(main())
