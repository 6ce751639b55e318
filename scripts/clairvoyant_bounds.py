#!/usr/bin/env python3
"""Computes the errors of the standard events that no controller can go below."""

from _bootstrap import start

if __name__ == "__main__":
    start("clairvoyant_bounds.bounds")
