"""What is told of a weld that was not as its scenario has it."""

from fsw_scenario.deviations import Deviations


def test_nothing_is_told_of_a_weld_as_it_was_planned():
    one = Deviations()
    one.count("nmpc", 50, 50)  # none was asked for
    one.ask("nmpc", 50)
    one.count("decentral", 60, 10)  # the switch takes its time
    one.count("", 90, 30)  # the supervisor has said nothing
    one.count("nmpc", 100, 10)
    assert str(one) == ""


def test_who_was_in_control_and_set_points_by_hand_are_told():
    one = Deviations()
    one.ask("nmpc", 0)
    one.count("decentral", 25, 25)
    one.count("decentral", 30, 5)
    one.note_by_hand(42)
    assert (
        str(one)
        == "; decentral was in control for 1.0 s, not asked for; set-points by hand from 4.2 s on"
    )
