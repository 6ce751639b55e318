"""Runs a campaign on Dask: hands out batches of welds and writes their rows as they come back."""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any

from dask import config
from distributed import Client, KilledWorker, LocalCluster, as_completed
from distributed.comm import get_address_host_port

from fsw_campaign.dataset import Dataset
from fsw_campaign.welds import ERROR, Row, run_batch, versions
from fsw_control.schema.models import InputError

#: time in which a scheduler and its first worker have to answer
PATIENCE_S = 10.0
#: target duration of a batch: handing it out then costs little, and little is lost with a worker
BATCH_S = 1.0
#: time allowed to the scheduler for each batch: with more than BATCH_S / HANDLING_S threads,
#: batches are longer
HANDLING_S = 0.01
_LARGEST_BATCH = 1024
#: batches in flight for each thread of the workers
_AHEAD = 3
#: rows are written at least this often
_WRITE_S = 2.0

#: Dask's own monitoring would cost more than handing out the welds
_LEAN = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.admin.system-monitor.log-length": 100,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.scheduler.active-memory-manager.start": False,
}

Task = list[tuple[int, dict[str, Any], list[str]]]


class SchedulerLostError(InputError):
    """The scheduler was lost during a campaign; all finished welds are written."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            "the scheduler is gone; all finished welds are written; start one and continue with "
            f"--resume ({reason})"
        )


@contextmanager
def connect(scheduler: str | None, workers: int | None) -> Iterator[Client]:
    """Client of a scheduler, or of a cluster of processes on this machine, one thread each.

    Raises
    ------
    InputError
        If the scheduler does not answer or has no workers.
    """
    for name in ("tornado", "asyncio", *logging.root.manager.loggerDict):
        if name.startswith(("distributed", "tornado", "asyncio")):
            logging.getLogger(name).setLevel(
                logging.CRITICAL + 1
            )  # failures are reported in one line
    with config.set({**_LEAN, "distributed.comm.timeouts.connect": f"{PATIENCE_S}s"}):
        if scheduler is None:
            # Ctrl-C on a terminal reaches the workers as well; it is for this process alone to end
            # them
            before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # they inherit that
            try:
                cluster = LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=workers,
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            finally:
                signal.signal(signal.SIGINT, before)
            with cluster, Client(cluster) as client:  # type: ignore[no-untyped-call]
                yield client
            return
        try:
            get_address_host_port(
                scheduler
            )  # a client that fails on a wrong one prints a traceback when it is deleted
            client = Client(scheduler, timeout=f"{PATIENCE_S}s", set_as_default=False)  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"no scheduler answers at {scheduler}: {reason}") from None
        try:
            try:
                client.wait_for_workers(1, timeout=PATIENCE_S)
            except TimeoutError:
                raise InputError(
                    f"the scheduler at {scheduler} has no workers; start some: dask worker ADDRESS"
                ) from None
            yield client
        finally:
            with suppress(Exception):  # the scheduler may be gone
                client.close(timeout=2)


def run(dataset: Dataset, client: Client, progress: Callable[[int], None] | None = None) -> int:
    """Run the missing welds and return how many were run; finished ones are always written.

    ``progress`` is called with the number of welds finished.

    Raises
    ------
    SchedulerLostError
        If the scheduler is lost.
    """
    text, tasks = dataset.campaign.text, _Tasks(dataset)
    under_way = as_completed(loop=client.loop, raise_errors=False)
    sent: dict[str, Task] = {}
    rows: list[Row] = []
    finished, written_s, threads = 0, time.monotonic(), _threads(client)

    def send() -> None:
        """Keep more batches in flight than there are threads."""
        while len(sent) < _AHEAD * threads and (task := next(tasks, None)):
            future = client.submit(run_batch, text, task, pure=False)
            sent[future.key] = task
            under_way.add(future)

    try:
        send()
        for future in under_way:
            task = sent.pop(future.key)
            # the scheduler may be lost at any moment, and a future cancelled between two queries
            batch = (
                _failed(future.exception(), task) if future.status == "error" else future.result()
            )
            del future
            rows += batch
            finished += len(batch)
            tasks.learn(batch, threads)
            send()
            if time.monotonic() > written_s + _WRITE_S:
                dataset.write(rows)
                rows, written_s = [], time.monotonic()
                threads = _threads(client)
            if progress is not None:
                progress(finished)
    except (
        OSError,
        RuntimeError,
        CancelledError,
    ) as error:  # what Dask raises when the scheduler is gone
        raise SchedulerLostError(" ".join(str(error).split())) from None
    finally:
        dataset.write(rows)
    return finished


def _threads(client: Client) -> int:
    return max(sum(map(int, client.nthreads().values())), 1)


class _Tasks:
    """Batches of the missing welds, each of about ``BATCH_S``, or more for many workers."""

    def __init__(self, dataset: Dataset) -> None:
        self._campaign = dataset.campaign
        self._missing = iter(dataset.missing())
        self._size, self._spent_s, self._rows = 1, 0.0, 0

    def learn(self, rows: list[Row], threads: int) -> None:
        """Adapt the size of the next batches to these rows' wall time and the threads."""
        self._spent_s += sum(row.get("wall_time_s", 0.0) for row in rows)
        self._rows += len(rows)
        per_weld_s = len(self._campaign.entrants) * self._spent_s / max(self._rows, 1)
        batch_s = max(BATCH_S, threads * HANDLING_S)
        self._size = min(max(int(batch_s / max(per_weld_s, 1e-6)), 1), _LARGEST_BATCH)

    def __iter__(self) -> _Tasks:
        return self

    def __next__(self) -> Task:
        chosen = list(islice(self._missing, self._size))
        if not chosen:
            raise StopIteration
        return [(index, self._campaign.parameters(index), labels) for index, labels in chosen]


def _failed(error: BaseException, task: Task) -> list[Row]:
    """Rows of a batch that could not be run."""
    if isinstance(error, CancelledError):
        raise error
    if not isinstance(error, KilledWorker):
        raise InputError(
            f"a worker cannot run welds: {type(error).__name__}: {' '.join(str(error).split())}"
        )
    row = {
        "status": ERROR,
        "reason": "the worker that ran this batch ended, several times in succession",
        "inside": False,
    }
    return [
        {"index": index, "controller": label, **parameters, **row, "versions": versions()}
        for index, parameters, labels in task
        for label in labels
    ]
