#!/usr/bin/env python3
"""Watch a weld: run_monitor.py --ros-args -p process:=canister."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_quality.monitor_node")
