"""What holds in every welding cell.

Explored breadth first to a small depth, and by random sequences far beyond.
"""

import sys
from itertools import product
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import settings as hypothesis_settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

sys.path.insert(0, str(Path(__file__).resolve().parent))

from explore import (
    ALPHABETS,
    CONTROL_TICKS,
    MODES,
    RECOVERY_TICKS,
    Explorer,
    Snapshot,
    started,
    state,
)

from fsw_test_support.welding_cell import ALPHABET, permuted

#: alphabets of a part of what may happen, with and without a gateway
BY_PART = [("safety", True), ("control", True), ("link", True), ("link", False)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("alphabet", "depth", "gateway"),
    [
        *(pytest.param(name, 3, gateway, marks=pytest.mark.full) for name, gateway in BY_PART),
        ("all", 2, True),
        ("link", 2, False),
    ],
)
def test_no_sequence_breaks_a_rule(alphabet, depth, gateway):
    modes = {mode: started(mode, gateway) for mode in MODES}
    result = Explorer(ALPHABETS[alphabet]).explore(modes, depth)
    assert not result.broken
    assert result.states > len(MODES) * len(ALPHABETS[alphabet])


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("alphabet, gateway", BY_PART)
def test_states_that_are_merged_go_on_alike(alphabet, gateway):
    """Whatever sequences led to a state, each letter leads on to the same state or breaks the same rule."""
    letters = ALPHABETS[alphabet]
    following: dict[int, tuple[tuple[str, ...], list[int]]] = {}
    merged = 0
    for mode in MODES:
        cell = started(mode, gateway)
        start = Snapshot(cell)
        for path in product(letters, repeat=2):
            start.restore()
            for letter in path:
                cell.step(letter)
            key, before, next_keys = state(cell), Snapshot(cell), []
            for letter in letters:
                before.restore()
                cell.step(letter)
                next_keys.append(state(cell))
            other, expected = following.setdefault(key, ((mode, *path), next_keys))
            merged += expected is not next_keys
            assert next_keys == expected, f"{(mode, *path)} and {other}"
    assert merged > 100


def test_the_orders_of_messages_are_all_different():
    assert len({tuple(permuted(list("abcd"), rank)) for rank in range(24)}) == 24


class CellMachine(RuleBasedStateMachine):
    """Long sequences; in the end the cell heals."""

    @initialize(gateway=st.booleans(), mode=st.sampled_from(MODES))
    def begin(self, gateway, mode):
        """A cell in some mode."""
        self.cell = started(mode, gateway)

    @rule(
        letter=st.sampled_from(ALPHABET),
        rank=st.integers(0, 40319),
        ticks=st.sampled_from([0, 0, 0, 1, 4, 15]),
    )
    def step(self, letter, rank, ticks):
        """A letter, with the messages in some order, and the condition lasts."""
        self.cell.step(letter, rank)
        for _ in range(ticks):
            self.cell.step("tick", rank)

    def teardown(self):
        """All is well from now on."""
        if not hasattr(self, "cell"):
            return
        for _ in range(RECOVERY_TICKS):
            if self.cell.control >= CONTROL_TICKS:
                return
            self.cell.heal()
        raise AssertionError(
            f"not in control after {RECOVERY_TICKS} "
            f"ticks: {self.cell.arbiter.machine.reason.words}"
        )


TestCell = pytest.mark.slow(CellMachine.TestCase)
TestCell.settings = hypothesis_settings(stateful_step_count=30, deadline=None)
