"""Packaging of fsw_supervisor for colcon."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "scripts"))
from _ament import setup_package

setup_package(__file__)
