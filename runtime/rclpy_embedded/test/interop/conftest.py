"""Both worlds in one domain: tests run on genuine rclpy, their peers on rclpy_embedded in processes of their own."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

_HERE = Path(__file__).parent
# What a sourced ROS 2 puts into the environment.
_ROS = ("AMENT_", "CMAKE_PREFIX_PATH", "COLCON_", "LD_LIBRARY_PATH", "PYTHONHOME", "PYTHONPATH", "RMW_", "ROS_DISTRO")


@pytest.fixture(autouse=True)
def _both_worlds(genuine: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not genuine:
        pytest.skip("needs genuine ROS 2 (sourced) beside rclpy_embedded")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")


def _python() -> str:
    """The interpreter with the dependencies of rclpy_embedded: RCLPY_EMBEDDED_PYTHON, a .venv above, or this one."""
    found = (folder / ".venv" / "bin" / "python" for folder in _HERE.parents)
    return os.environ.get("RCLPY_EMBEDDED_PYTHON") or next((str(p) for p in found if p.exists()), sys.executable)


@pytest.fixture
def start(run_program: Callable[..., Any], capfd: pytest.CaptureFixture[str]) -> Iterator[Callable[..., Any]]:
    """Start a program of ``peers/`` on rclpy_embedded, or on genuine rclpy, and wait until it is ready.

    Whatever it does, genuine ROS 2 in this process has nothing to complain of.
    """
    programs: list[Any] = []

    def run(name: str, *args: str, genuine: bool = False) -> Any:
        peers = _HERE / "peers"
        source = f"import sys\nsys.path.append({str(peers)!r})\n" + (peers / f"{name}.py").read_text()
        if genuine:
            program = run_program(source, *args)
        else:
            environ = {key: value for key, value in os.environ.items() if not key.startswith(_ROS)}
            # The definitions of packages that rclpy_embedded does not bring along.
            shares = [f"{prefix}/share" for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
            environ["RCLPY_EMBEDDED_INTERFACE_PATH"] = os.pathsep.join(shares)
            program = run_program(source, *args, python=_python(), environ=environ)
        programs.append(program)
        assert program.line() == "ready", program.process.communicate(timeout=10)
        return program

    yield run
    # Peers that say goodbye: genuine writers wait 10 s for those that do not.
    for program in programs:
        program.process.terminate()
        program.process.wait(240)
    assert not re.search("WARN|ERROR|FATAL", capfd.readouterr().err)
