"""Commands where ROS 2, or only this project's messages, are not installed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

#: modules of these packages cannot be found
WITHOUT = """
import importlib.util
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {missing}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name.split(".")[0] in {missing} else found(name, package)
from fsw.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("missing", [("rclpy", "fsw_msgs"), ("fsw_msgs",)])
@pytest.mark.parametrize(
    "words", ["status", "node recorder --help", "simulate quick --bag", "demo --live"]
)
def test_command_without_ros_is_one_line(
    missing: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    command = [sys.executable, "-c", WITHOUT.format(missing=missing), *words.split()]
    ran = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert ran.returncode == 1
    assert (
        ran.stderr.count("\n") == 1
        and "needs ROS 2" in ran.stderr
        and "docs/how-to/install.md" in ran.stderr
    )
    assert not list(tmp_path.iterdir())
