#!/usr/bin/env python3
"""The operator's command: steer a weld, simulate welds, look at bags, identify a process and tune for it."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_experiment.cli.main")
