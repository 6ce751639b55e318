"""What is told of a weld that was not as its scenario has it."""

import pytest

from fsw_scenario.running_kpi import Deviations
from fsw_scenario.weld_outcome import Outcome, WeldEnd


def test_nothing_is_told_of_a_weld_as_it_was_planned():
    one = Deviations()
    one.count("nmpc", 50, 50)  # none was asked for
    one.ask("nmpc", 50)
    one.count("decentral", 60, 10)  # the switch takes its time
    one.count("", 90, 30)  # the supervisor has said nothing
    one.count("nmpc", 100, 10)
    assert (one.others_s, one.by_hand_from_s, one.facts) == ({}, None, ())


def test_who_was_in_control_and_set_points_by_hand_are_told():
    one = Deviations()
    one.ask("nmpc", 0)
    one.count("decentral", 25, 25)
    one.count("decentral", 30, 5)
    one.note_by_hand(42)
    assert one.others_s == pytest.approx({"decentral": 1.0})
    assert one.by_hand_from_s == pytest.approx(4.2)
    assert [fact.code for fact in one.facts] == [WeldEnd.UNREQUESTED, WeldEnd.BY_HAND]
    assert Outcome("done", one.facts[0], one.facts[1:]).words.count("; ") == 1
