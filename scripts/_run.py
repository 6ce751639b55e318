#!/usr/bin/env python3
"""Runs the node that the called script is named after: ``run_plant.py`` is a link to this file."""

import sys
from pathlib import Path

from _bootstrap import start

if __name__ == "__main__":
    start(Path(sys.argv[0]).stem.removeprefix("run_"))
