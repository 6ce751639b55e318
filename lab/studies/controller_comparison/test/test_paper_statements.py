"""The paper's statements.

How each is judged, and that they hold with the preset that is to be the paper.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[4] / "benchmarks"))

import paper_statements

from fsw_tuning.standard_cases import CONSERVATIVE


def test_only_turns_by_as_much_as_a_move_count():
    wave = np.sin(np.linspace(0.0, 4.0 * np.pi, 200))
    assert paper_statements.turns(5.0 * wave, 3.0) == 4
    assert paper_statements.turns(1.0 * wave, 3.0) == 0
    assert paper_statements.turns(np.linspace(0.0, 50.0, 20), 3.0) == 0


def test_half_of_a_move_is_timed_upwards():
    assert paper_statements.half_s(np.array([0.0, 1.0, 2.0, 3.0, 4.0, 0.0])) == pytest.approx(0.2)


@pytest.mark.full
def test_all_five_hold_with_the_preset_paper_and_not_with_the_rival():
    paper, rival = map(paper_statements.measured, ("nmpc:paper", CONSERVATIVE))
    assert all(paper_statements.answers(paper, rival).values())
    assert not all(paper_statements.answers(rival, rival).values())
