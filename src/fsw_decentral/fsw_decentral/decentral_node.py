"""The decentralized controller as a node."""

import sys
from functools import partial

from fsw_control import run_controller
from fsw_decentral import DecentralController

main = partial(run_controller, DecentralController)

if __name__ == "__main__":
    sys.exit(main())
