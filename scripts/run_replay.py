#!/usr/bin/env python3
"""Publish a bag into the graph: run_replay.py out/weld --ros-args -p rate:=2.0."""

import sys

from _bootstrap import ensure

ensure()

from fsw_recorder.replay_node import main  # noqa: E402

sys.exit(main())
