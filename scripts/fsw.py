#!/usr/bin/env python3
"""The command line.

Control and simulate welds, inspect and judge bags, identify, tune, export, run campaigns.
"""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw.main")
