"""Two supervisors and a plant over a lossy network: no random walk breaks an invariant (``pair_rules.py``)."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from explore_pair import walk, walks

TRANSITIONS = 120_000


@pytest.mark.slow
@pytest.mark.requirement("S9", "S25", "S38")
@pytest.mark.parametrize("seed", [1, 100_000])
def test_no_walk_breaks_an_invariant(seed):
    found = None
    for found in walks(seed, TRANSITIONS):
        assert not found.broken, found.broken
    assert found.transitions >= TRANSITIONS
    assert found.accepted > TRANSITIONS / 100, "commands have acted"
    assert {ok for _, ok in found.answers} >= {True, False}


@pytest.mark.requirement("S9", "S25")
@pytest.mark.parametrize(
    "letters",
    [
        ("freeze end", "ask safe_stop a", "ms 70", "kill a", "start a", "run 5", "thaw end messages", "run 12"),
        ("freeze a", "run 5", "ask safe_stop b", "run 3", "thaw a timers", "run 12", "run 12"),
        ("ask safe_stop a", "run 2", "kill a", "kill b", "start a", "start b", "run 12"),
        ("kill a", "kill b", "run 12", "run 12", "start a", "start b", "run 12", "run 12"),
        ("isolate a", "ask safe_stop a", "run 5", "network well", "run 12"),
        ("kill a", "start a", "ms 5", "ask hold a", "run 5"),
    ],
)
def test_counter_examples_of_earlier_versions(letters):
    """A stop in a pause, terms that restart, both killed, the watchdog's ramp, a partition, a fresh supervisor."""
    _, error = walk(letters)
    assert error is None
