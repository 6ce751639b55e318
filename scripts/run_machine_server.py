#!/usr/bin/env python3
"""Runs a machine to test the gateway with: an OPC UA server on top of the plant emulator."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_test_support.machine_server", extras=("machine",))
