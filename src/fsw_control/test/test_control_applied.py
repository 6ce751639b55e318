"""The command that a controller has to follow is the one before the tick, however early the next one arrives."""

from fsw_control.applied import AppliedCommands
from fsw_control.contract import Command

INITIAL, FIRST, SECOND = Command(78.4, 407.0), Command(79.0, 408.0), Command(80.0, 409.0)


def test_initial_until_the_first_command():
    applied = AppliedCommands(INITIAL)
    assert applied.before(100) == applied.latest == INITIAL
    assert applied.source == ""


def test_a_command_that_answers_the_tick_itself_does_not_count_yet():
    applied = AppliedCommands(INITIAL)
    applied.add(100, FIRST, "nmpc")
    applied.add(200, SECOND, "decentral")
    assert applied.before(100) == INITIAL
    assert applied.before(200) == FIRST
    assert applied.before(300) == applied.latest == SECOND
    assert applied.source == "decentral"


def test_time_that_goes_back_forgets_what_was_later():
    applied = AppliedCommands(INITIAL)
    applied.add(5000, FIRST, "nmpc")
    applied.add(100, SECOND, "nmpc")
    assert applied.before(200) == SECOND
    assert applied.before(9000) == SECOND


def test_memory_is_bounded():
    applied = AppliedCommands(INITIAL)
    for tick in range(1000):
        applied.add(tick, Command(float(tick), 400.0), "nmpc")
    assert applied.before(10) == Command(900.0, 400.0)
    assert applied.before(2000) == Command(999.0, 400.0)
