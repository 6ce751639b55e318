#!/usr/bin/env python3
"""Runs welds in closed loop over DDS and shows the results; the first run sets everything up.

usage: demo.py [--realtime] [--scenario NAME] [--controller NAME] [--out FOLDER]
       demo.py --live [--port PORT] [--scenario NAME] [--controller NAME] [--out FOLDER]
"""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw.demo")
