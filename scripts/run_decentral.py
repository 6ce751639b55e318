#!/usr/bin/env python3
"""Runs the decentralized controller as a node."""

import sys

from _bootstrap import ensure

if __name__ == "__main__":
    ensure()
    from fsw_decentral.decentral_node import main

    sys.exit(main())
