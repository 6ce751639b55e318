#!/usr/bin/env python3
"""The operator's command: status, reference, disturb, fault, switch, controllers, mode, simulate, bag."""

import sys

from _bootstrap import ensure

if __name__ == "__main__":
    ensure()
    from fsw_experiment.cli.main import main

    sys.exit(main())
