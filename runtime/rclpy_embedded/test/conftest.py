"""Fixtures: a DDS domain of its own for every test, spinning until a condition holds, programs in other processes."""

from __future__ import annotations

import fcntl
import itertools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

_SOURCE = Path(__file__).parent.parent
if "ROS_DISTRO" in os.environ:
    # "python -m pytest" in that folder puts it first.
    sys.path[:] = [path for path in sys.path if Path(path).resolve() != _SOURCE]

import rclpy  # noqa: E402
from rclpy.clock import ROSClock  # noqa: E402
from rclpy.clock_type import ClockType  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.time import Time  # noqa: E402

_GENUINE = _SOURCE not in Path(rclpy.__file__).resolve().parents and "ROS_DISTRO" in os.environ
#: For what comes within seconds on an idle machine: on a busy one a process takes a minute to start.
PATIENCE_S = 240.0
# Every test has another domain: participants that were killed linger in theirs until their lease ends.
_DOMAINS = range(20, 101)
_turns = itertools.count(os.getpid())

# The other tests look inside rclpy_embedded.
collect_ignore_glob = ["test_*.py"] if _GENUINE else []


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "slow: starts nodes or processes")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What needs a domain starts nodes or processes."""
    for item in items:
        if Path(__file__).parent in item.path.parents and "domain_id" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def genuine() -> bool:
    """Whether rclpy is that of ROS 2; what differs is known and asks for this."""
    return _GENUINE


@pytest.fixture(autouse=True)
def default_context() -> Iterator[None]:
    """The global context is new for every test, whatever the one before left behind."""
    rclpy.try_shutdown()
    yield
    rclpy.try_shutdown()


@contextmanager
def _free_domain() -> Iterator[int]:
    """A domain that no other test on this machine uses now."""
    for turn in itertools.islice(_turns, len(_DOMAINS)):
        domain = _DOMAINS[turn % len(_DOMAINS)]
        with (Path(tempfile.gettempdir()) / f"ros_domain_{domain}.lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            yield domain
            return
    pytest.fail("all test domains are in use")


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A domain that no other test on this machine uses now; ROS_DOMAIN_ID is set to it."""
    with _free_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        yield domain


@pytest.fixture
def other_domain_id(domain_id: int) -> Iterator[int]:
    """Another one."""
    with _free_domain() as domain:
        yield domain


@pytest.fixture
def context(domain_id: int) -> Iterator[Context]:
    """An initialized context, with all its nodes gone after the test."""
    context = Context()
    context.init(args=[], domain_id=domain_id)
    yield context
    context.destroy()


@pytest.fixture
def node(context: Context) -> Iterator[Any]:
    """A node named test_node."""
    node = rclpy.create_node("test_node", context=context)
    yield node
    node.destroy_node()


@pytest.fixture
def manual_clock() -> tuple[ROSClock, Callable[[float], None]]:
    """A ROS clock that shows simulated time, and the function that sets it, in milliseconds."""
    clock = ROSClock()
    clock._set_ros_time_is_active(True)

    def set_ms(milliseconds: float) -> None:
        clock.set_ros_time_override(Time(nanoseconds=int(milliseconds * 1e6), clock_type=ClockType.ROS_TIME))

    return clock, set_ms


class Spinner:
    """An executor with a node, spun until a condition holds."""

    def __init__(self, context: Context) -> None:
        self.executor = SingleThreadedExecutor(context=context)

    def until(self, condition: Callable[[], Any], timeout_sec: float = PATIENCE_S) -> bool:
        """Spin until `condition` is true; return whether it is."""
        end = time.monotonic() + timeout_sec
        while not condition() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.01)
        return bool(condition())

    def rest(self, cycles: int = 20) -> None:
        """Run what is ready, so that what should not happen had its chance."""
        for _ in range(cycles):
            self.executor.spin_once(timeout_sec=0.005)


@pytest.fixture
def spinner(context: Context, node: Any) -> Iterator[Spinner]:
    """Spins the fixture `node` and whatever is added to its executor."""
    spinner = Spinner(context)
    spinner.executor.add_node(node)
    yield spinner
    spinner.executor.shutdown()


class Program:
    """A Python program in another process; its output is read line by line."""

    def __init__(self, source: str, *args: str, python: str = sys.executable, environ: Any = None) -> None:
        environ = dict(os.environ if environ is None else environ)
        if "ROS_DISTRO" not in environ:
            environ["PYTHONPATH"] = f"{_SOURCE}{os.pathsep}{environ.get('PYTHONPATH', '')}"
        self.process = subprocess.Popen(
            [python, "-P", "-u", "-c", source, *args],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environ,
        )

    def line(self) -> str:
        """Return the next line of output, '' at its end."""
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def finish(self, timeout_sec: float = PATIENCE_S) -> tuple[int, str, str]:
        """Wait for the end; return exit code, remaining output and errors."""
        out, err = self.process.communicate(timeout=timeout_sec)
        return self.process.returncode, out, err


@pytest.fixture
def run_program(domain_id: int) -> Iterator[Callable[..., Program]]:
    """Start programs in the test's domain; they are killed after the test."""
    programs: list[Program] = []

    def run(source: str, *args: str, **options: Any) -> Program:
        programs.append(Program(source, *args, **options))
        return programs[-1]

    yield run
    for program in programs:
        if program.process.poll() is None:
            program.process.kill()
        program.process.wait()
        for stream in (program.process.stdin, program.process.stdout, program.process.stderr):
            if stream is not None:
                stream.close()


def wait_until(condition: Callable[[], Any], timeout_sec: float = PATIENCE_S) -> bool:
    """Wait, without spinning, until `condition` is true; return whether it is."""
    end = time.monotonic() + timeout_sec
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return bool(condition())


@pytest.fixture(name="wait_until")
def _wait_until() -> Callable[..., bool]:
    return wait_until
