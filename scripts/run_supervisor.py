#!/usr/bin/env python3
"""Runs the supervisor node."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_supervisor.supervisor_node")
