#!/usr/bin/env python3
"""Tunes the decentralized controller on the process model and prints gains, robustness and errors."""

from _bootstrap import start

if __name__ == "__main__":
    start("decentral_tuning.command")
