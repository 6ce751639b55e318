"""Graphs of processes that serve many faults in turn, and the table of what was measured.

With FSW_FAULT_TABLE=docs/results/faults.md the figures are written into the table of that file.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from fault_table import Table
from faulty_weld import Weld

from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher

TABLE_FILE = os.environ.get("FSW_FAULT_TABLE", "")


@pytest.fixture(scope="session")
def table():
    """Figures of all faults; written at the end if asked for."""
    table = Table()
    yield table
    if TABLE_FILE:
        table.write(Path(TABLE_FILE))


@pytest.fixture(scope="module")
def launch(tmp_path_factory):
    """Makes graphs, each in a domain of its own and each the only one at its time."""
    current = []

    def make(fresh=False, **options):
        if not fresh and current and current[0] == options:
            return current[1]
        end()
        domains = free_domain()
        launcher = Launcher(tmp_path_factory.mktemp("log"), domain := domains.__enter__())
        weld = Weld(domain, launcher, tmp_path_factory.mktemp("weld"), **options)
        current[:] = [None if fresh else options, weld, launcher, domains]
        return weld

    def end():
        if current:
            _, weld, launcher, domains = current
            weld.close()
            launcher.stop()
            domains.__exit__(None, None, None)
            current.clear()

    try:
        yield make
    finally:
        end()


@pytest.fixture
def weld(launch):
    """A weld in real time under ``decentral``, with ``nmpc`` and ``rogue`` as shadows and a standby supervisor."""
    return launch(standby=True)


@pytest.fixture
def steps(launch):
    """The same in lockstep, without a standby."""
    return launch(lockstep=True)


@pytest.fixture
def behind_relay(launch):
    """In real time, with a relay between the plant and the others."""
    return launch(relayed=True)
