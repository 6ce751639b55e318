#!/usr/bin/env python3
"""Plays a scenario in the running graph; the plant needs the same file as its parameter ``scenario``.

usage: run_scenario.py [SCENARIO] [--ros-args -p use_sim_time:=true ...]
"""

import sys

from _bootstrap import ensure

if __name__ == "__main__":
    ensure()
    from fsw_experiment.scenario_node import main

    sys.exit(main())
