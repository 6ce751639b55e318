#!/usr/bin/env python3
"""Runs the plant node."""

from _bootstrap import ensure

ensure()

import sys  # noqa: E402

from fsw_plant.plant_node import main  # noqa: E402

sys.exit(main())
