#!/usr/bin/env python3
"""Fits the disturbances of the scenario `realistic` to published statistics, welds with it, and writes its page."""

from _bootstrap import start

if __name__ == "__main__":
    start("realistic.command", ["campaign", "canister"])
