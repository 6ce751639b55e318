#!/usr/bin/env python3
"""Record every topic to a bag: run_recorder.py --ros-args -p output:=out/weld."""

import sys

from _bootstrap import ensure

if __name__ == "__main__":
    ensure()
    from fsw_recorder.recorder_node import main

    sys.exit(main())
