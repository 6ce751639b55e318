#!/usr/bin/env python3
"""Runs the gateway to a machine."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_machine.machine_node")
