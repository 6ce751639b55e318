#!/usr/bin/env python3
"""Runs the decentralized controller as a node."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_decentral.decentral_node")
