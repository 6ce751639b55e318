"""The sides that a benchmark compares: rclpy_embedded, bare cyclonedds and, where ROS 2 is sourced, genuine rclpy."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from report import save

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


def compare(measure: Callable[[str, Side], dict[str, float]], json_path: Path | None) -> None:
    """Measure all sides; print and save the figures, and the embedded ones through those of every other side."""
    measured = {name: measure(name, side) for name, side in sides().items()}
    embedded, *others = measured
    print(f"{'':<26}" + "".join(f"{name:>16}" for name in measured) + "".join(f"{f'/ {name}':>14}" for name in others))
    figures = {f"{name}_{key}": value for name, of in measured.items() for key, value in of.items()}
    for key, value in measured[embedded].items():
        row = "".join(f"{of[key]:>16.3f}" if key in of else f"{'':>16}" for of in measured.values())
        for other in others:
            against = measured[other].get(key, 0.0)
            if against > 0.0:
                figures[f"ratio_{other}_{key}"] = value / against
            row += f"{value / against:>14.2f}" if against > 0.0 else f"{'':>14}"
        print(f"{key:<26}{row}")
    save(figures, json_path)


class RclpyNode:
    """A node with an executor and messages of bytes, for rclpy_embedded and genuine rclpy alike."""

    def __init__(self, name: str) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from std_msgs.msg import UInt8MultiArray

        rclpy.init(args=[])
        self.kind = UInt8MultiArray
        self.node: Any = rclpy.create_node(name)
        self.executor: Any = SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def make(self, size: int) -> Any:
        """A message of so many bytes."""
        return self.kind(data=bytes(size))


class BareParticipant:
    """Cyclonedds alone, as its documentation shows it: a wait set, topics with a struct of bytes."""

    def __init__(self) -> None:
        from dataclasses import dataclass

        from cyclonedds.core import Policy, Qos, WaitSet
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.idl import IdlStruct
        from cyclonedds.idl.types import sequence, uint8

        @dataclass
        class Sample(IdlStruct, typename="Sample"):  # type: ignore[call-arg]
            data: sequence[uint8]  # type: ignore[valid-type]

        # The annotation has to be the type itself, not its name.
        Sample.__annotations__["data"] = sequence[uint8]
        self._sample = Sample
        self._participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        self._qos = Qos(Policy.Reliability.Reliable(10**9), Policy.History.KeepLast(10))
        self.waitset = WaitSet(self._participant)
        self._conditions: list[Any] = []

    def make(self, size: int) -> Any:
        """A sample of so many bytes."""
        return self._sample(data=bytes(size))

    def writer(self, name: str) -> Any:
        """Writer of a topic."""
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        return DataWriter(self._participant, Topic(self._participant, name, self._sample), self._qos)

    def reader(self, name: str) -> Any:
        """Reader of a topic; the wait set wakes when it has something."""
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        reader: Any = DataReader(self._participant, Topic(self._participant, name, self._sample), self._qos)
        state = ViewState.Any | InstanceState.Any | SampleState.NotRead
        self._conditions.append(ReadCondition(reader, state))
        self.waitset.attach(self._conditions[-1])
        return reader
