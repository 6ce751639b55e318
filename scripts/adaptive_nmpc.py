#!/usr/bin/env python3
"""Measures the NMPC's preset adaptive on random plants and where the speed is at its bound, and writes the page."""

from _bootstrap import start

if __name__ == "__main__":
    start("adaptive_nmpc.command", ["campaign"])
