"""The launch file without ROS 2's launch system, which is not among the wheels."""

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from fsw_scenario.weld_options import WeldOptions

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


class Node(SimpleNamespace):
    """The options of a node action."""


def launching(monkeypatch: pytest.MonkeyPatch, folder: Path) -> Callable[..., list[Node]]:
    """Function that makes the nodes of the launch file for arguments, with its files in a folder.

    It raises ValueError for an argument or a choice that is not declared, as launch does.
    """
    modules = fake_launch(monkeypatch)
    modules["launch_ros.actions"].Node = Node
    modules["launch.logging"].launch_config.log_dir = str(folder)
    modules["ament_index_python.packages"].get_package_share_directory = lambda _: str(
        LAUNCH_FILE.parents[1]
    )
    values: dict[str, str] = {}
    modules["launch.substitutions"].LaunchConfiguration = lambda name: SimpleNamespace(
        perform=lambda _: values[name]
    )

    def launch(**arguments: str) -> list[Node]:
        names = run_launch_file()
        declared = {
            name: (default, choices) for name, default, _, choices in WeldOptions.arguments()
        }
        values.update({name: default for name, (default, _) in declared.items()})
        for name, value in arguments.items():
            if name not in values or value not in (declared[name][1] or [value]):
                raise ValueError(f"{name}:={value}")
        values.update(arguments)
        return [action for action in names["weld"](None) if isinstance(action, Node)]

    return launch
