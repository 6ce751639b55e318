#!/usr/bin/env python3
"""Compares NMPC, decentralized controller, the paper's tuning and the clairvoyant optimum."""

from _bootstrap import start

if __name__ == "__main__":
    start("controller_comparison.command")
