#!/usr/bin/env python3
"""Tunes the decentralized controller on the process model and prints gains, robustness and errors."""

import sys

from _bootstrap import ensure

if __name__ == "__main__":
    ensure()
    from fsw_experiment.tune_decentral import main

    sys.exit(main())
