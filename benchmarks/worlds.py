"""The sides a benchmark compares: rclpy_embedded, bare cyclonedds and, where ROS 2 is sourced, genuine rclpy."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parent.parent
# What a sourced ROS 2 puts into the environment.
_ROS = ("AMENT_", "CMAKE_PREFIX_PATH", "COLCON_", "LD_LIBRARY_PATH", "PYTHONHOME", "PYTHONPATH", "RMW_", "ROS_DISTRO")

Side = tuple[str, dict[str, str]]


def sides() -> dict[str, Side]:
    """Return interpreter and environment of each side that is here, the embedded one first.

    Those without ROS 2 need the dependencies of rclpy_embedded: the interpreter is RCLPY_EMBEDDED_PYTHON, that of
    ``.venv`` in this workspace, or the present one.
    """
    os.environ.setdefault("ROS_DOMAIN_ID", str(101 + os.getpid() % 60))
    own = WORKSPACE / ".venv" / "bin" / "python"
    python = os.environ.get("RCLPY_EMBEDDED_PYTHON") or (str(own) if own.exists() else sys.executable)
    clean = {key: value for key, value in os.environ.items() if not key.startswith(_ROS)}
    clean["PYTHONPATH"] = str(WORKSPACE / "runtime" / "rclpy_embedded")
    found = {"rclpy_embedded": (python, clean)}
    if "ROS_DISTRO" in os.environ:
        found["genuine"] = sys.executable, {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", **os.environ}
    found["cyclonedds"] = python, clean
    return found


def output(side: Side, *arguments: str) -> str:
    """Run Python on a side; return the last line it prints."""
    python, environ = side
    done = subprocess.run([python, *arguments], env=environ, check=True, stdout=subprocess.PIPE, text=True, timeout=600)
    return done.stdout.splitlines()[-1]


def ratios(figures: dict[str, dict[str, float]]) -> dict[str, float]:
    """Return the embedded figures through those of every other side, as ``ratio_<side>_<figure>``."""
    first, *others = figures
    return {
        f"ratio_{other}_{key}": value / figures[other][key]
        for other in others
        for key, value in figures[first].items()
        if figures[other].get(key, 0) > 0
    }
