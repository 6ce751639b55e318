"""Ament package of the command line and the launch files."""

import runpy
from pathlib import Path

COMMON = runpy.run_path(str(Path(__file__).resolve().parents[2] / "scripts/_ament_package.py"))
COMMON["set_up"](__file__, shared=["launch/*.launch.py", "config/*"])
