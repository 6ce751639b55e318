"""What a controller in shadow proposed, compared with what was applied."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fsw_analysis.shadow import compare_shadow, missed_samples
from fsw_analysis.signals import load_weld
from fsw_recorder import BagError


def test_same_weld_is_equal(weld_bag: Path) -> None:
    weld = load_weld(weld_bag)
    name = next(iter(weld.proposals))
    report = compare_shadow(weld, weld, name, 0)
    own = report.comparisons[1]
    assert report.ticks == own.ticks == 300 and report.unanswered == 0
    assert own.force.first_tick == own.speed.first_tick == -1 and own.force.largest == 0.0
    text = "\n".join(report.lines())
    assert "equal bit by bit" in text and "note" not in text
    json.dumps(report.values(), allow_nan=False)


def test_first_and_largest_difference(weld_bag: Path) -> None:
    weld = load_weld(weld_bag)
    name, proposal = next(iter(weld.proposals.items()))
    force = weld.force_kn.copy()
    force[40] += 0.5
    force[90] -= 2.0
    force[299] = np.nan
    force[100] = np.nan
    shown = replace(weld, proposals={name: replace(proposal, force_kn=force, speed_rpm=weld.speed_rpm)})
    report = compare_shadow(weld, shown, name, 3)
    applied = report.comparisons[0]
    assert applied.force.first_tick == 40 and applied.force.first == pytest.approx(0.5)
    assert applied.force.largest == pytest.approx(2.0) and applied.force.largest_s == pytest.approx(9.1)
    assert applied.force.mean == pytest.approx(2.5 / 298) and applied.force.differing == 2
    assert applied.speed.differing == 0 and applied.ticks == 298 and report.unanswered == 1
    assert "3 samples reached the controller too late" in "\n".join(report.lines())


def test_part_of_a_weld(weld_bag: Path) -> None:
    weld = load_weld(weld_bag)
    name = next(iter(weld.proposals))
    late = replace(weld, stamp_ns=weld.stamp_ns + 10 * int(weld.stamp_ns[1] - weld.stamp_ns[0]))
    assert compare_shadow(weld, late, name).ticks == 290
    with pytest.raises(BagError, match="no tick"):
        compare_shadow(weld, replace(weld, stamp_ns=weld.stamp_ns + 10**15), name)
    with pytest.raises(BagError, match="proposed nothing"):
        compare_shadow(weld, weld, "nobody")


def test_controller_that_says_nothing(weld_bag: Path) -> None:
    assert missed_samples(weld_bag, "nobody") == -1
