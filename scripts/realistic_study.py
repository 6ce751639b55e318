#!/usr/bin/env python3
"""Fits the scenario `realistic` to published statistics, welds with it, writes its page."""

from _bootstrap import start

if __name__ == "__main__":
    start("realistic.command", ["campaign", "canister"])
