"""What is told of a weld that was not as its scenario has it."""

import pytest

from fsw_scenario.running_kpi import Deviations, Outcome, WeldEnd


def test_planned_weld_has_no_deviations():
    deviations = Deviations()
    deviations.count("nmpc", 50, 50)  # none was asked for
    deviations.ask("nmpc", 50)
    deviations.count("decentral", 60, 10)  # the switch takes its time
    deviations.count("", 90, 30)  # the supervisor has said nothing
    deviations.count("nmpc", 100, 10)
    assert (deviations.others_s, deviations.by_hand_from_s, deviations.facts) == ({}, None, ())


def test_unrequested_controller_and_manual_set_points_are_deviations():
    deviations = Deviations()
    deviations.ask("nmpc", 0)
    deviations.count("decentral", 25, 25)
    deviations.count("decentral", 30, 5)
    deviations.note_by_hand(42)
    assert deviations.others_s == pytest.approx({"decentral": 1.0})
    assert deviations.by_hand_from_s == pytest.approx(4.2)
    assert [fact.code for fact in deviations.facts] == [WeldEnd.UNREQUESTED, WeldEnd.BY_HAND]
    assert Outcome("done", deviations.facts[0], deviations.facts[1:]).words.count("; ") == 1
