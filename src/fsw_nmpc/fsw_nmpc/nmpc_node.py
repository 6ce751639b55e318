"""The NMPC as a node."""

import sys
from functools import partial

from fsw_control import run_controller
from fsw_nmpc import NmpcController

main = partial(run_controller, NmpcController)

if __name__ == "__main__":
    sys.exit(main())
