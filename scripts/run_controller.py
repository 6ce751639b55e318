#!/usr/bin/env python3
"""Runs any controller as a node: NAME, or MODULE:CLASS or FILE.py:CLASS of your own controller."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_scenario.controller_node")
