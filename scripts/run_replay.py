#!/usr/bin/env python3
"""Publish a bag into the graph: run_replay.py out/weld --ros-args -p rate:=2.0."""

import sys

from _bootstrap import ensure

if __name__ == "__main__":
    ensure()
    from fsw_recorder.replay_node import main

    sys.exit(main())
