#!/usr/bin/env python3
"""Runs the plant node."""

from _bootstrap import start

if __name__ == "__main__":
    start("fsw_plant.plant_node")
