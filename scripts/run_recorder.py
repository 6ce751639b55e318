#!/usr/bin/env python3
"""Record every topic to a bag: run_recorder.py --ros-args -p output:=out/weld."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_recorder.recorder_node")
