"""Two supervisors and plant or gateway over a lossy network.

No sequence breaks an invariant (``pair_rules.py``).
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from explore_pair import explore, random_walks, short_sequences, walk

from fsw_test_support.pair_ends import ENDS

TRANSITIONS = 60_000


@pytest.mark.slow
@pytest.mark.requirement("S9", "S25", "S38")
@pytest.mark.parametrize("machine", ENDS)
@pytest.mark.parametrize("seed", [1, 100_000])
def test_no_walk_breaks_an_invariant(machine, seed):
    result = None
    for result in explore(random_walks(seed, machine), machine, TRANSITIONS):
        assert not result.broken, result.broken
    assert result.transitions >= TRANSITIONS
    assert result.accepted > TRANSITIONS / 100, "commands have acted"
    assert {ok for _, ok in result.answers} >= {True, False}


@pytest.mark.slow
@pytest.mark.requirement("S9", "S25")
@pytest.mark.parametrize("machine", ENDS)
def test_no_short_sequence_breaks_an_invariant(machine):
    for result in explore(short_sequences(2), machine):
        assert not result.broken, result.broken


@pytest.mark.requirement("S9", "S25")
@pytest.mark.parametrize(
    "letters",
    [
        (
            "freeze end",
            "ask safe_stop a",
            "ms 70",
            "kill a",
            "start a",
            "run 5",
            "thaw end messages",
            "run 12",
        ),
        ("freeze a", "run 5", "ask safe_stop b", "run 3", "thaw a timers", "run 12", "run 12"),
        ("ask safe_stop a", "run 2", "kill a", "kill b", "start a", "start b", "run 12"),
        ("kill a", "kill b", "run 12", "run 12", "start a", "start b", "run 12", "run 12"),
        ("isolate a", "ask safe_stop a", "run 5", "network well", "run 12"),
        ("kill a", "start a", "ms 5", "ask hold a", "run 5"),
        ("isolate a", "link cut b end", "run 12", "run 5", "run 12"),
        ("link cut b end", "ms 70", "wish 84", "link cut end a", "run 3"),
        (
            "ms 30",
            "freeze b",
            "kill a",
            "start a",
            "run 1",
            "freeze a",
            "ms 70",
            "run 2",
            "run 5",
            "run 12",
        ),
        ("freeze b", "press", "isolate end", "run 12", "run 5"),
        ("wish 84", "link cut end b", "run 5", "freeze a", "network dup", "run 2"),
        ("wish 84", "run 5", "link cut a b", "ask safe_stop a", "run 12", "kill a", "run 3"),
        ("run 5", "link cut a b", "wish 84", "run 5", "kill a", "run 3"),
        (
            "ms 30",
            "network late",
            "freeze a",
            "run 3",
            "isolate end",
            "run 6",
            "run 12",
            "network lossy",
            "run 1",
        ),
    ],
)
def test_counter_examples_of_earlier_versions(letters):
    """A stop in a pause, terms that restart, both killed, the watchdog's ramp, a partition, a fresh supervisor.

    Commands that do not arrive, a backlog after the plant's ramp, a standby that has missed
    measurements or commands.
    """
    _, error = walk(letters)
    assert error is None


@pytest.mark.requirement("S25", "S33")
@pytest.mark.parametrize(
    "letters",
    [
        ("freeze a", "plc mute", "run 3", "freeze b", "press", "ms 70", "run 3"),
        ("kill a", "run 1", "plc deaf", "run 1", "kill b", "run 3"),
        ("freeze a", "ms 30", "kill end", "run 12", "start end"),
        (
            "network dup",
            "press",
            "run 5",
            "ask acknowledge a",
            "ms 30",
            "run 5",
            "freeze a",
            "isolate b",
            "ask acknowledge a",
            "press",
            "ms 30",
        ),
        ("plc mute", "run 12", "run 5", "ms 30", "kill end", "ask acknowledge a", "ask auto a"),
        (
            "isolate a",
            "ms 30",
            "link dup end b",
            "run 5",
            "ask hold b",
            "network swap",
            "run 1",
            "ask auto b",
            "run 2",
        ),
    ],
)
def test_counter_examples_with_the_gateway(letters):
    """A command that waits when a stop comes, fresh supervisors after a failed write, a fresh gateway after a ramp.

    A stop that comes between an acknowledgement and a report that has waited, a report of the mode
    before.
    """
    _, error = walk(letters, "gateway")
    assert error is None
