"""Campaigns on Dask: the same results whatever the number of workers, and whoever is killed."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest
import yaml
from distributed import Client
from distributed.client import FutureCancelledError

from fsw_campaign import dataset, definition, engine
from fsw_campaign.dataset import TIMES, Dataset
from fsw_campaign.welds import run_batch
from fsw_control.schema.models import InputError
from fsw_test_support.waiting import PATIENCE_S, wait_until

pytestmark = pytest.mark.slow
SCRIPT = Path(__file__).parents[2] / "scripts" / "fsw.py"
CAMPAIGN = {
    "name": "short",
    "scenario": {
        "name": "short",
        "duration_s": 8.0,
        "events": [{"at_s": 2.0, "reference": {"depth_mm": 2.7}}],
    },
    "controllers": ["nmpc", "decentral:tight"],
    "welds": 40,
    "distributions": {"plant.factors.depth_gain_mm_per_kn_s": {"uniform": [0.7, 1.4]}},
    "limits": {"depth_error_mm": {"min": -0.03, "max": 0.03}},
}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text(yaml.safe_dump(CAMPAIGN))
    return path


@pytest.fixture(scope="module")
def expected():
    """Rows of the whole campaign, run one after the other without Dask."""
    made = definition.read(yaml.safe_load(yaml.safe_dump(CAMPAIGN)))
    labels = [entrant.label for entrant in made.entrants]
    rows = run_batch(made.text, [(i, made.parameters(i), labels) for i in range(made.welds)])
    return [
        without_times(row)
        for row in sorted(rows, key=lambda row: (row["index"], row["controller"]))
    ]


def without_times(row):
    return {
        key: value
        for key, value in row.items()
        if key not in TIMES and value is not None and key != "events"
    }


def found(folder):
    table = dataset.load(folder)[1]
    assert table.num_rows == len({(row["index"], row["controller"]) for row in table.to_pylist()})
    return [without_times(row) for row in table.to_pylist()]


def command(log, *arguments):
    """A campaign as a process, in a session of its own.

    Its workers outlive it a little when it is killed.
    """
    with log.open("w") as stream:
        return subprocess.Popen(
            [sys.executable, str(SCRIPT), "campaign", *map(str, arguments)],
            stderr=stream,
            start_new_session=True,
        )


def wait_for_rows(folder, process):
    def are_written():
        assert process.poll() is None, "it ended without rows"
        return list((folder / "welds").glob("0*.parquet"))

    wait_until(are_written, "rows")


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.full
def test_results_do_not_depend_on_the_number_of_workers(file, tmp_path, expected, workers):
    with (
        engine.connect(None, workers) as client,
        Dataset(tmp_path / "out", definition.load(file)) as written,
    ):
        assert engine.run(written, client) == len(expected)
    assert found(tmp_path / "out") == expected


@pytest.mark.full
def test_a_killed_worker_loses_nothing(file, tmp_path, expected):
    with (
        engine.connect(None, 2) as client,
        Dataset(tmp_path / "out", definition.load(file)) as written,
    ):
        victims = list(client.run(os.getpid).values())[:1]

        def kill(_):
            while victims:
                os.kill(victims.pop(), signal.SIGKILL)

        assert engine.run(written, client, kill) == len(expected)
        assert not victims
    assert found(tmp_path / "out") == expected


@pytest.mark.full
def test_batch_that_kills_its_worker_is_reported(file, tmp_path, monkeypatch):
    made = definition.load(file, welds=1)
    with engine.connect(None, 1) as client, Dataset(tmp_path / "out", made) as written:
        client.run_on_scheduler(
            lambda dask_scheduler: setattr(dask_scheduler, "allowed_failures", 0)
        )
        monkeypatch.setattr(engine, "run_batch", lambda text, task: os._exit(1))
        assert engine.run(written, client) == 2
    assert {row["status"] for row in found(tmp_path / "out")} == {"error"}


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.full
def test_resume_continues_after_a_killed_or_interrupted_client(file, tmp_path, expected, how):
    out = tmp_path / "out"
    log = tmp_path / "log"
    first = command(log, file, "--out", out, "--workers", 1)
    wait_for_rows(out, first)
    if how == signal.SIGINT:  # Ctrl-C reaches all processes
        os.killpg(first.pid, how)
        assert first.wait(PATIENCE_S) == 130
        output = log.read_text()
        assert output.splitlines()[-1].startswith("interrupted") and "Traceback" not in output
    else:
        first.kill()
        first.wait()
    rows = found(out)
    assert rows and all(row in expected for row in rows)
    second = command(log, file, "--out", out, "--workers", 2, "--resume")
    assert second.wait(PATIENCE_S) == 0, log.read_text()
    assert found(out) == expected


@pytest.fixture
def cluster(tmp_path):
    """A scheduler and a worker in processes of their own.

    Address of the first, and both processes.
    """
    where = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    module = [sys.executable, "-m", "distributed.cli"]
    options = ["--scheduler-file", str(where), "--no-dashboard"]
    scheduler = subprocess.Popen(
        [*module[:2], f"{module[2]}.dask_scheduler", "--port", "0", *options], **quiet
    )
    worker = subprocess.Popen(
        [*module[:2], f"{module[2]}.dask_worker", "--nthreads", "1", *options], **quiet
    )
    wait_until(lambda: where.exists() and where.read_text(), "the scheduler's address")
    address = yaml.safe_load(where.read_text())["address"]
    with Client(address, timeout=PATIENCE_S, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=PATIENCE_S)  # the product waits for a few seconds only
    yield address, scheduler
    for process in (worker, scheduler):
        process.terminate()
        process.wait(PATIENCE_S)


@pytest.mark.full
def test_a_scheduler_by_address_and_its_loss(file, tmp_path, expected, cluster):
    address, scheduler = cluster
    made = definition.load(file)
    with Dataset(tmp_path / "out", made) as written:

        def kill(_):
            scheduler.kill()
            scheduler.wait()

        with (
            pytest.raises(engine.SchedulerLostError),
            engine.connect(address, None) as client,
        ):
            engine.run(written, client, kill)
    rows = found(tmp_path / "out")
    assert rows and all(row in expected for row in rows)
    with (
        engine.connect(None, 1) as client,
        Dataset(tmp_path / "out", made, resume=True) as written,
    ):
        engine.run(written, client)
    assert found(tmp_path / "out") == expected


@pytest.mark.parametrize("status", ["finished", "error", "cancelled"])
def test_the_scheduler_may_be_lost_between_two_questions_to_a_future(
    file, tmp_path, monkeypatch, status
):
    lost = FutureCancelledError("key", "scheduler-connection-lost")
    future = Mock(status=status, key="key")
    future.result.side_effect = lost
    future.exception.return_value = lost
    client = Mock()
    client.submit.return_value = future
    client.nthreads.return_value = {"worker": 1}
    monkeypatch.setattr(engine, "as_completed", lambda **options: Queue([future]))
    with (
        Dataset(tmp_path / "out", definition.load(file)) as written,
        pytest.raises(engine.SchedulerLostError),
    ):
        engine.run(written, client)


class Queue(list):
    """Stands for ``as_completed``: these futures have ended."""

    def add(self, future):
        pass


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "foo://host:1"])
def test_no_scheduler_is_one_line(monkeypatch, address):
    monkeypatch.setattr(engine, "PATIENCE_S", 0.5)
    with pytest.raises(InputError, match=f"scheduler .*{address}"):
        engine.connect(address, None).__enter__()
