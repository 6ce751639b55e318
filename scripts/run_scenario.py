#!/usr/bin/env python3
"""Plays a scenario in the running graph; the plant needs the same file as its parameter ``scenario``.

usage: run_scenario.py [SCENARIO] [--ros-args -p use_sim_time:=true ...]
"""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_scenario.scenario_node")
