#!/usr/bin/env python3
"""Runs welds in closed loop over DDS and shows the results; the first run sets everything up.

usage: demo.py [--realtime] [--scenario NAME] [--controller NAME] [--out FOLDER]
"""

import sys

from _bootstrap import ensure

if __name__ == "__main__":
    ensure()
    from fsw_experiment.demo import main

    sys.exit(main())
