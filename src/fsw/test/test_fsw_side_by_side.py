"""Several weld graphs at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fsw.simulate_command import run_side_by_side
from fsw_scenario.launcher import Launcher, LaunchError
from fsw_test_support.waiting import PATIENCE_S


class Weld:
    """In the place of a graph: runs ``body`` and counts those that run beside it."""

    running: list[Weld] = []
    most = 0

    def __init__(self, folder: Path, body: Callable[[Callable[[float], None]], None]) -> None:
        self.folder, self.body, self.domain = folder, body, 0

    def run(self, launcher: Launcher, progress: Callable[[float], None]) -> float:
        self.domain = launcher.domain
        Weld.running.append(self)
        Weld.most = max(Weld.most, len(Weld.running))
        try:
            self.body(progress)
        finally:
            Weld.running.remove(self)
        return 0.0


@pytest.fixture(autouse=True)
def count_anew() -> None:
    Weld.running, Weld.most = [], 0


def together(*welds: Weld, at_a_time: int) -> None:
    graphs: Any = welds
    run_side_by_side(graphs, at_a_time)


def test_parallel_welds_use_separate_domains(tmp_path: Path) -> None:
    met = threading.Barrier(
        2, timeout=PATIENCE_S
    )  # broken, and a failure, if one runs after the other
    welds = [
        Weld(tmp_path / str(number), lambda progress: (met.wait(), progress(1.0))[1])
        for number in range(4)
    ]
    together(*welds, at_a_time=2)
    assert Weld.most == 2
    assert len({weld.domain for weld in welds}) == 4
    assert all((weld.folder / "log").is_dir() for weld in welds)


def test_a_failure_ends_the_others_and_is_raised(tmp_path: Path) -> None:
    failed, ended = threading.Event(), []

    def fail(_: Callable[[float], None]) -> None:
        failed.set()
        raise LaunchError("ended")

    def weld_on(progress: Callable[[float], None]) -> None:
        failed.wait(PATIENCE_S)
        try:
            while True:
                progress(0.5)
        except BaseException:
            ended.append(True)
            raise

    def never(_: Callable[[float], None]) -> None:
        raise AssertionError("began after the failure")

    welds = [
        Weld(tmp_path / name, body)
        for name, body in (("a", weld_on), ("b", fail), ("c", weld_on), ("d", never))
    ]
    with pytest.raises(LaunchError, match=r"^ended$"):
        together(*welds, at_a_time=2)
    assert ended and Weld.running == []
