#!/usr/bin/env python3
"""Record every topic to a bag: run_recorder.py --ros-args -p output:=out/weld."""

import sys

from _bootstrap import ensure

ensure()

from fsw_recorder.recorder_node import main  # noqa: E402

sys.exit(main())
