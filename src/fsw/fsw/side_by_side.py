"""Runs several weld graphs at a time, each in its own ROS domain."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed

from fsw.progress import ProgressBar
from fsw_control.free_domain import free_domain
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher


class _StoppedError(Exception):
    """Another weld has failed, or the user has interrupted."""


def run_side_by_side(graphs: Sequence[WeldGraph], at_a_time: int) -> None:
    """Run all welds to their ends; on a failure or Ctrl-C end all and raise the first exception.

    A lockstep weld waits for messages half of the time; about one weld per core is the fastest.
    """
    stop = threading.Event()
    shares = [0.0] * len(graphs)

    def run(position: int, graph: WeldGraph, bar: ProgressBar) -> None:
        def progress(share: float) -> None:
            if stop.is_set():
                raise _StoppedError
            shares[position] = share
            bar(sum(shares) / len(shares))

        if stop.is_set():
            raise _StoppedError
        with free_domain() as domain, Launcher(graph.folder / "log", domain) as launcher:
            graph.run(launcher, progress)

    title = f"{len(graphs)} welds, {min(at_a_time, len(graphs))} at a time"
    # threads that live until all welds have ended: the kernel ends the children of a dead thread
    with ProgressBar(title) as bar, ThreadPoolExecutor(at_a_time) as pool:
        futures = [pool.submit(run, position, graph, bar) for position, graph in enumerate(graphs)]
        try:
            for future in as_completed(futures):
                future.result()
        except BaseException:
            stop.set()
            raise
