#!/usr/bin/env python3
"""Runs the NMPC as a node."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_nmpc.nmpc_node")
