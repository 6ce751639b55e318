#!/usr/bin/env python3
"""Runs the NMPC as a node."""

import sys

from _bootstrap import ensure

if __name__ == "__main__":
    ensure()
    from fsw_nmpc.nmpc_node import main

    sys.exit(main())
