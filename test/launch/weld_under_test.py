"""What the launch tests share: the weld that they start, and an observer in its graph.

A test module names its weld once, as ``WELD``. Under ``launch_test`` it is started by
``weld.launch.py`` of the built workspace; under plain pytest, with or without ROS, ``conftest.py``
has it started as plain processes.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from fsw_control.fast_dds import stay_on_this_machine
from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import parse

try:
    from launch_testing import post_shutdown_test
except ImportError:

    def post_shutdown_test() -> Callable[[type], type]:
        """Mark a class of tests that run when all processes have ended, as launch_testing does."""

        def mark(test_class: type) -> type:
            test_class.__post_shutdown_test__ = True  # type: ignore[attr-defined]
            return test_class

        return mark


__all__ = ["Exit", "Observer", "WeldUnderTest", "exit_codes", "kill", "post_shutdown_test"]
DEEP = QoSProfile(depth=1000)
TICK_NS = 100_000_000
stay_on_this_machine(os.environ)


@dataclass(frozen=True)
class Exit:
    """How a process has ended, with the names that launch uses."""

    process_name: str
    returncode: int


@dataclass(frozen=True)
class WeldUnderTest:
    """A weld to be tested while it runs, in real time.

    Attributes
    ----------
    scenario : str
        YAML text; longer than the tests take.
    controllers : tuple of str
    record : bool
    standby : bool
        Whether a second supervisor stands by.
    """

    scenario: str
    controllers: tuple[str, ...]
    record: bool = False
    standby: bool = False

    def launch_description(self) -> tuple[Any, dict[str, Any]]:
        """What ``generate_test_description`` returns.

        ``weld.launch.py``, and arguments for the tests.
        """
        from ament_index_python.packages import get_package_share_directory
        from launch import LaunchDescription
        from launch.actions import IncludeLaunchDescription, SetEnvironmentVariable
        from launch.launch_description_sources import PythonLaunchDescriptionSource
        from launch_testing.actions import ReadyToTest

        until_the_end = contextlib.ExitStack()
        atexit.register(until_the_end.close)
        domain = until_the_end.enter_context(free_domain())
        folder = Path(tempfile.mkdtemp(prefix="fsw_launch_test_"))
        until_the_end.callback(shutil.rmtree, folder, ignore_errors=True)
        scenario = folder / "scenario.yaml"
        scenario.write_text(self.scenario, encoding="utf-8")
        arguments = {
            "scenario": str(scenario),
            "controllers": ",".join(self.controllers),
            "record": str(self.record).lower(),
            "standby": str(self.standby).lower(),
            "bag_dir": str(folder / "bag"),
        }
        launch_file = Path(get_package_share_directory("fsw")) / "launch" / "weld.launch.py"
        description = LaunchDescription(
            [
                SetEnvironmentVariable("ROS_DOMAIN_ID", str(domain)),
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(str(launch_file)),
                    launch_arguments=list(arguments.items()),
                ),
                ReadyToTest(),
            ]
        )
        return description, {"domain": domain, "bag": folder / "bag"}

    @contextlib.contextmanager
    def plain_processes(self, folder: Path) -> Iterator[tuple[dict[str, Any], Callable[[], None]]]:
        """Run the weld without launch.

        Yields the arguments for the tests, with launch_testing's ``proc_info``, and a function
        that ends the processes as launch does.
        """
        scenario = parse(self.scenario, overrides=[f"controller={self.controllers[0]}"])
        from fsw_test_support.patient_weld import PatientWeld

        exits: list[Exit] = []
        with (
            free_domain() as domain,
            Launcher(folder / "log", domain, patience_s=240.0) as launcher,
        ):
            options = {"realtime": True, "record": self.record, "standby": self.standby}
            graph = PatientWeld(scenario, folder, self.controllers, **options)
            graph.start(launcher)

            def stop() -> None:
                if not exits:
                    codes = launcher.stop()
                    exits.extend(
                        Exit(f"{name}-{i}", code)
                        for i, (name, code) in enumerate(codes.items(), 1)
                    )

            yield {"domain": domain, "bag": graph.bag, "proc_info": exits}, stop


def kill(domain: int, word: str, but: str | None = None) -> None:
    """Kill -9 the one process in a ROS domain whose command line has the one text and not the other."""
    messages = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            here = f"ROS_DOMAIN_ID={domain}".encode() in (folder / "environ").read_bytes().split(
                b"\0"
            )
            command = (folder / "cmdline").read_bytes().decode(errors="replace")
            if here and word in command and (but is None or but not in command):
                messages.append(int(folder.name))
    assert len(messages) == 1, f"{len(messages)} processes of {word!r} in domain {domain}"
    os.kill(messages[0], signal.SIGKILL)


def exit_codes(proc_info: Iterable[Any]) -> dict[str, int]:
    """Exit code by program."""
    return {info.process_name.rpartition("-")[0]: info.returncode for info in proc_info}


class Observer:
    """A node that looks on; to be used as a context.

    Parameters
    ----------
    domain : int
        ROS domain of the weld.
    """

    def __init__(self, domain: int) -> None:
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self.node = Node("observer", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def listen(self, kind: Any, topic: str, profile: QoSProfile = DEEP) -> list[Any]:
        """A list that gets every message of a topic."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, profile)
        return messages

    def until(self, condition: Callable[[], Any], what: str, timeout_s: float = 240.0) -> None:
        """Spin until a condition holds; AssertionError when it takes too long."""
        end_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end_s, f"waited {timeout_s:g} s without success for {what}"
            self._executor.spin_once(timeout_sec=0.05)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """The answer of a service."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, name)
        future = client.call_async(request)
        self.until(future.done, f"an answer of {name}")
        self.node.destroy_client(client)
        return future.result()


def stamp_ns(message: Any) -> int:
    """Stamp of a message."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
