"""What is known of the command in force: own and foreign commands, and what pushes the drives besides."""

import pytest

from fsw_control.contract import Command, Limits
from fsw_supervisor.command_watch import BumplessStart, CommandWatch, Push
from fsw_supervisor.tick import Decision, ProposalInput, Tick, check, same

STAMP_NS = 10**12
SENT = Decision(STAMP_NS, Command(80.0, 410.0), "nmpc")


# ---------------------------------------------------------------- own and foreign commands


@pytest.mark.requirement("S11")
@pytest.mark.parametrize(
    ("stamp_ns", "source", "command", "own"),
    [
        (STAMP_NS, "nmpc", Command(80.0, 410.0), True),
        (STAMP_NS, "nmpc", Command(80.0 + 1e-9, 410.0 - 1e-8), True),
        (STAMP_NS, "nmpc", Command(80.001, 410.0), False),
        (STAMP_NS, "nmpc", Command(80.0, 410.001), False),
        (STAMP_NS, "decentral", Command(80.0, 410.0), False),
        (STAMP_NS + 1, "nmpc", Command(80.0, 410.0), False),
    ],
)
def test_a_command_is_its_own_if_stamp_source_and_values_are_those_sent(stamp_ns, source, command, own):
    watch = CommandWatch()
    watch.sent(Decision(STAMP_NS - 1, Command(79.0, 409.0), "hold"))
    watch.sent(SENT)
    assert watch.is_own(stamp_ns, source, command) == own
    assert not watch.is_own(stamp_ns, source, command), "each counts once"


def test_the_last_fifty_commands_are_known_as_its_own():
    watch = CommandWatch()
    sent = [Decision(number, SENT.command, "nmpc") for number in range(51)]
    for decision in sent:
        watch.sent(decision)
    assert [n for n in range(51) if watch.is_own(n, "nmpc", SENT.command)] == list(range(1, 51))


@pytest.mark.requirement("S11")
def test_a_foreign_writer_is_remembered_for_five_seconds():
    watch = CommandWatch()
    assert not watch.seen_lately(0.0)
    assert watch.note_foreign(10.0, 3), "it is the first"
    assert not watch.note_foreign(12.0, 4)
    assert (watch.foreign_commands, watch.foreign_tick) == (2, 4)
    assert watch.seen_lately(17.0)
    assert not watch.seen_lately(17.1)
    assert watch.note_foreign(17.1, 90), "it is the first for a while"


# ---------------------------------------------------------------- what pushes


def learnt(*differences, follows=20):
    """A push after a drive that has followed for some ticks has shown these differences; one move is 1."""
    push = Push()
    for difference in (0.0,) * follows + differences:
        push.learn(difference, 1.0)
    return push


@pytest.mark.requirement("S12")
@pytest.mark.parametrize(
    ("differences", "value"),
    [
        ((4.0, 4.0), 0.0),
        ((4.0, 4.0, 4.0), 4.0),
        ((-4.0, -4.0, -4.0), -4.0),
        ((4.0, 4.5, 3.5), 3.5),
        ((4.0, 4.6, 4.0), 0.0),
        ((4.0, 4.6, 4.6, 4.6, 4.6), 0.0),
        ((1.1, 1.1, 1.1), 1.1),
        ((1.0, 1.0, 1.0), 0.0),
        ((0.6, 1.5, 1.5, 1.5), 0.0),
        ((10.0, 10.0, 10.0), 10.0),
        ((10.1, 10.1, 10.1), 0.0),
        ((4.0, None, 4.0, 4.0, 4.0), 0.0),
        ((4.0, 4.0, None, 4.0), 0.0),
        ((4.0, 4.0, 4.0, 0.0, 0.0, 0.0), 0.0),
        ((4.0, 4.0, 4.0, 8.0, 8.0, 8.0), 8.0),
        ((4.0, 4.0, 4.0, 8.0, 8.0), 4.0),
    ],
)
def test_a_difference_is_a_push_if_it_sets_in_at_once_and_stays_for_three_ticks(differences, value):
    push = learnt(*differences)
    assert push.value == pytest.approx(value, abs=0.06)


def test_a_push_that_was_learnt_is_followed_slowly():
    push = learnt(4.0, 4.0, 4.0)
    for count in range(1, 5):
        push.learn(4.4, 1.0)
        assert push.value == pytest.approx(4.0 + 0.05 * count)
    for _ in range(50):
        push.learn(4.4, 1.0)
    assert push.value == pytest.approx(4.4)
    for count in range(1, 5):
        push.learn(4.0, 1.0)
        assert push.value == pytest.approx(4.4 - 0.05 * count)


def test_what_is_further_off_than_half_a_move_is_under_way_and_not_learnt():
    push = learnt(4.0, 4.0, 4.0, *(4.6,) * 50)
    assert push.value == pytest.approx(4.0)
    assert learnt(4.0, 4.0, 4.0, *(4.5,) * 50).value == pytest.approx(4.5)


@pytest.mark.parametrize(("follows", "kept"), [(0, True), (1, False), (2, False), (3, True)])
def test_after_a_gap_a_push_is_kept_only_if_the_drive_has_followed_for_three_ticks_since_the_gap_before(follows, kept):
    push = learnt(4.0, 4.0, 4.0)
    push.interrupt()
    assert push.value == 4.0
    if follows:
        for _ in range(follows):
            push.learn(4.0, 1.0)
        push.interrupt()
    assert push.value == (4.0 if kept else 0.0)


def test_right_after_a_gap_no_difference_is_a_push():
    push = learnt()
    push.interrupt()
    for _ in range(20):
        push.learn(4.0, 1.0)
    assert push.value == 0.0


def start_with(push_kn, push_rpm, ticks=20):
    """What is known when the drives have followed for long and then are pushed."""
    start, limits = BumplessStart(), Limits()
    told = Command(80.0, 410.0)
    for count in range(ticks + 5):
        pushed = Command(80.0 + push_kn, 410.0 + push_rpm) if count >= ticks else told
        start.learn_offset(Tick(count, 0.0, 0.08, told, drives=pushed), limits)
    return start


@pytest.mark.requirement("S12")
@pytest.mark.parametrize(("push_kn", "push_rpm"), [(4.0, 0.0), (0.0, -9.0), (-3.0, 12.0)])
def test_what_pushes_is_taken_off_what_the_drives_report(push_kn, push_rpm):
    command = start_with(push_kn, push_rpm).commanded(Command(80.0 + push_kn, 410.0 + push_rpm))
    assert (command.force_kn, command.speed_rpm) == pytest.approx((80.0, 410.0))


def test_differences_within_one_move_of_each_drive_are_no_push():
    start = start_with(1.0, 3.0)
    assert start.commanded(Command(81.0, 413.0)) == Command(81.0, 413.0)


@pytest.mark.parametrize("what", ["drives", "before", "begun"])
def test_where_the_command_or_the_drives_are_not_known_nothing_is_learnt(what):
    start, limits = start_with(0.0, 0.0), Limits()
    told, pushed = Command(80.0, 410.0), Command(84.0, 419.0)
    if what == "begun":
        start.begin_from(told)
    gap = Tick(99, 0.0, 0.08, None if what == "before" else told, drives=None if what == "drives" else pushed)
    start.learn_offset(gap, limits)
    for count in range(5):
        start.learn_offset(Tick(100 + count, 0.0, 0.08, told, drives=pushed), limits)
    assert start.commanded(pushed) == pushed


# ---------------------------------------------------------------- after a start or a gap


def test_until_its_first_command_it_hears_who_was_selected_and_what_was_commanded():
    start = BumplessStart()
    start.hear_status("nmpc", False)
    assert start.was_active == ""
    start.hear_status("nmpc", True)
    start.hear_command(Command(81.0, 411.0))
    start.hear_command(Command(float("nan"), 411.0))
    assert (start.was_active, start.seen) == ("nmpc", Command(81.0, 411.0))
    start.note_applied(Command(80.0, 410.0))
    start.hear_status("decentral", True)
    start.hear_command(Command(60.0, 310.0))
    assert (start.was_active, start.seen, start.asking) == ("nmpc", Command(81.0, 411.0), False)


def test_the_time_to_listen_counts_from_the_first_measurement():
    start = BumplessStart()
    assert start.listening_ends_s(0.3) is None
    start.begin(50.0)
    start.begin(51.0)
    assert start.listening_ends_s(0.3) == 50.3
    start.note_applied(Command(80.0, 410.0))
    assert start.listening_ends_s(0.3) is None


def test_at_a_gap_it_keeps_who_was_active_and_what_was_in_force():
    start = BumplessStart()
    start.note_applied(Command(80.0, 410.0))
    start.interrupt("nmpc")
    assert (start.was_active, start.seen, start.applied, start.asking) == ("nmpc", Command(80.0, 410.0), None, False)
    start.interrupt("")
    assert (start.was_active, start.seen) == ("nmpc", Command(80.0, 410.0))
    start.forget_active()
    assert start.was_active == ""


def test_after_a_gap_before_the_first_command_the_time_to_listen_begins_anew():
    start = BumplessStart()
    start.begin(50.0)
    start.interrupt("")
    assert start.listening_ends_s(0.3) is None
    start.begin(60.0)
    start.hear_status("nmpc", True)
    assert (start.listening_ends_s(0.3), start.was_active) == (60.3, "nmpc")


def test_a_feedback_of_the_drives_that_is_not_finite_is_none():
    start = BumplessStart()
    assert not start.hear_drives(1, Command(80.0, 410.0))
    assert start.hear_drives(1, Command(81.0, 410.0)), "its stamp was seen before"
    assert not start.hear_drives(2, Command(float("inf"), 410.0))
    assert (start.feedback(1), start.feedback(2)) == (Command(81.0, 410.0), None)


# ---------------------------------------------------------------- the check of a proposal


def test_a_proposal_is_checked_for_its_name_then_its_health_then_its_values():
    limits, before = Limits(), Command(80.0, 410.0)
    wrong = ProposalInput(1, "x" * 60, Command(120.0, 410.0), healthy=False, reason="ill")
    refused = check("a", wrong, before, limits)
    assert (refused.refusal, refused.malformed, refused.jump) == (
        f"proposal names the source {'x' * 40!r} instead of 'a'",
        True,
        False,
    )
    ill = check("a", ProposalInput(1, "a", Command(120.0, 410.0), healthy=False), before, limits)
    assert (ill.refusal, ill.malformed) == ("the controller says it is unhealthy, without a reason", False)
    assert check("a", ProposalInput(1, "a", Command(80.0, 410.0), False, "ill"), before, limits).refusal == "ill"
    for command, jump in ((Command(120.0, 410.0), False), (Command(82.0, 410.0), True)):
        candidate = check("a", ProposalInput(1, "a", command), before, limits)
        assert (candidate.command, bool(candidate.refusal), candidate.malformed) == (command, True, True)
        assert candidate.jump == jump
    good = check("a", ProposalInput(1, "a", Command(82.0, 410.0)), None, limits)
    assert (good.refusal, good.malformed, good.jump, good.command) == ("", False, False, Command(82.0, 410.0))


def test_commands_are_the_same_but_for_rounding():
    one = Command(80.0, 410.0)
    assert same(one, Command(80.0 * (1 + 5e-10), 410.0 * (1 - 5e-10)))
    assert not same(one, Command(80.0 * (1 + 5e-9), 410.0))
    assert not same(one, Command(80.0, 410.0 * (1 + 5e-9)))


@pytest.mark.parametrize("stalled", [True, False])
@pytest.mark.parametrize("sampled", [True, False])
def test_a_tick_blames_nobody_if_the_supervisor_was_held_up_or_no_sensor_has_come(stalled, sampled):
    tick = Tick(1, 0.0, 0.08, None, samples={"depth": 2.6} if sampled else {}, stalled=stalled)
    words = "the arbiter was held up" if stalled else "" if sampled else "no sensor has come, only the drives' feedback"
    assert tick.blameless == words
    tick.decide()
    assert (tick.decided, tick.decision, tick.blameless) == (True, None, words)
    tick.stalled, tick.samples = not stalled, {}
    assert tick.blameless == words, "settled with the decision"


def test_an_excuse_of_the_decision_counts_before_others():
    tick = Tick(1, 0.0, 0.08, None, stalled=True)
    tick.decide(SENT, "an excuse")
    assert (tick.decision, tick.blameless) == (SENT, "an excuse")
