#!/usr/bin/env python3
"""Runs the server of the operator's page, live or over bags."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_hmi.main")
