"""What all tests share.

Hypothesis has no deadline and does not mind slow examples, for a busy machine decides how long one
takes. And what the tests of a file leave in the environment ends with it: Dask, for one, leaves
settings of malloc there for its workers.

Linear algebra has one thread, here and in the processes that tests start: several tests run at a
time, and threads of OpenBLAS that have no core to themselves spin.
"""

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from fsw_control.fast_dds import stay_on_this_machine

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # before the first import of numpy, in test files
stay_on_this_machine(os.environ)  # before the first node: Fast DDS reads its profiles once
#: With CI in the environment each run has the same examples: it judges a commit, not its luck.
_PATIENT = settings(
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize=bool(os.environ.get("CI")),
)
settings.register_profile("project", _PATIENT, max_examples=30)
# scripts/test.py --full. Where examples repeat in each run, more of them search nothing new.
settings.register_profile("full", _PATIENT, max_examples=200 if _PATIENT.derandomize else 400)
settings.load_profile("project")


_CORE = Path(__file__).resolve().parent / "src"
#: What libraries keep, a browser above all; an example of a property test that leaves one leaves
#: hundreds.
MOST_FILES_LEFT = 50


def _open_files() -> int:
    return len(os.listdir("/proc/self/fd"))


def pytest_configure(config: pytest.Config) -> None:
    """A worker that has died ends the run: with another in its place xdist may wait for ever."""
    if getattr(config.option, "maxworkerrestart", "") is None:
        config.option.maxworkerrestart = "0"


def pytest_collection_finish() -> None:
    """What was imported and collected stays.

    The collector, which comes after every file, need not visit it again.
    """
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the core's fast tests."""
    for item in items:
        own = {mark.name for mark in item.iter_markers()}
        if _CORE in item.path.parents and not own & {"slow", "full", "real_time"}:
            item.add_marker(pytest.mark.core)


@pytest.fixture(autouse=True, scope="module")
def environment() -> Iterator[None]:
    """The environment after a file is that before it, and hardly a file is left open."""
    before, open_before = dict(os.environ), _open_files()
    yield
    changed = [name for name in os.environ if os.environ[name] != before.get(name)]
    for name in changed:
        del os.environ[name]
    os.environ.update(before)
    gc.collect()
    left = _open_files() - open_before
    assert left <= MOST_FILES_LEFT, f"{left} files are left open"
