#!/usr/bin/env python3
"""The operator's command: status, reference, disturb, fault, switch, controllers, mode, simulate, campaign, model,
export, bag.
"""

import sys

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_experiment.cli.main", extras=("campaign",) if sys.argv[1:2] == ["campaign"] else ())
