#!/usr/bin/env python3
"""Welds random canisters that no controller knows; writes the page with the verdict."""

from _bootstrap import start

if __name__ == "__main__":
    start("canister.command", ["campaign", "canister"])
