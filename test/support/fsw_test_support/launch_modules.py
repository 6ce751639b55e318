"""The launch file without ROS 2's launch system, which is not among the wheels."""

import runpy
import sys
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest

LAUNCH_FILE = Path(__file__).resolve().parents[3] / "src" / "fsw" / "launch" / "weld.launch.py"
#: what the launch file imports of ROS 2
_NAMES = (
    "ament_index_python",
    "ament_index_python.packages",
    "launch",
    "launch.actions",
    "launch.events",
    "launch.events.process",
    "launch.logging",
    "launch.substitutions",
    "launch_ros",
    "launch_ros.actions",
)


def fake_launch(monkeypatch: pytest.MonkeyPatch) -> dict[str, MagicMock]:
    """Put fakes in the place of the modules that the launch file imports; returns them by name."""
    modules = {name: MagicMock() for name in _NAMES}
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    return modules


def run_launch_file() -> dict[str, Any]:
    """Names that the launch file defines."""
    return runpy.run_path(str(LAUNCH_FILE))
