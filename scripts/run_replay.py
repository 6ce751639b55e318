#!/usr/bin/env python3
"""Publish a bag into the graph: run_replay.py out/weld --ros-args -p rate:=2.0."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_recorder.replay_node")
