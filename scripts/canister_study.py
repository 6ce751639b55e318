#!/usr/bin/env python3
"""Welds random canisters that no controller knows, and writes the page of validation and verdict."""

from _bootstrap import start

if __name__ == "__main__":
    start("canister.command", ["campaign", "canister"])
