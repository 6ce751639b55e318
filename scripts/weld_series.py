#!/usr/bin/env python3
"""Welds a series of canisters and writes its history, records and report.

Weld_series.py [--welds N] [--out DIR].
"""

from _bootstrap import start

if __name__ == "__main__":
    start("weld_series.command", ("canister", "history", "pdf"))
