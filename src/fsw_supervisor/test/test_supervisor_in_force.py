"""What is known of the command in force.

Own and foreign commands, and the offset between drive and command.
"""

import pytest

from fsw_control.contract import Command, Limits
from fsw_control.reason import Reason, ReasonCode
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.in_force import CommandInForce, CommandWatch, DriveOffset
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.start_up import StartUp
from fsw_supervisor.state_machine import Machine
from fsw_supervisor.tick import Decision, Outcome, ProposalInput, Tick, check, same

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
def test_a_command_is_its_own_if_stamp_source_and_values_are_those_sent(
    stamp_ns, source, command, own
):
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


def test_commands_of_another_supervisor_are_foreign_only_when_the_takeover_does_not_end():
    watch = CommandWatch()
    assert not any(
        watch.note_foreign(10.0 + 0.1 * tick, tick, by_supervisor=True) for tick in range(20)
    )
    assert (watch.foreign_commands, watch.foreign_tick, watch.seen_lately(12.0)) == (20, 19, False)
    assert not watch.note_foreign(20.0, 100, by_supervisor=True), "the next takeover"
    assert not any(
        watch.note_foreign(20.0 + 0.1 * tick, 100 + tick, by_supervisor=True)
        for tick in range(1, 20)
    )
    assert watch.note_foreign(22.1, 121, by_supervisor=True), (
        "it does not end: two supervisors lead"
    )
    assert watch.seen_lately(22.1)


def test_takeovers_to_and_fro_on_a_busy_computer_are_no_foreign_writer() -> None:
    watch = CommandWatch()
    for takeover in range(20):  # one after the other, each noticed a second late
        for late in range(10):
            assert not watch.note_foreign(
                2.0 * takeover + 0.1 * late, takeover, by_supervisor=True
            )
        watch.change_role()
    assert not watch.seen_lately(40.0)
    assert watch.note_foreign(40.0, 400), "one that is not signed is"


# ---------------------------------------------------------------- offsets of the drives


def learnt(*differences, follows=20):
    """The offset of a drive that has followed for some ticks and then shows these differences.

    One move is 1.
    """
    offset = DriveOffset()
    for difference in (0.0,) * follows + differences:
        offset.learn(difference, 1.0)
    return offset


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
def test_a_difference_is_an_offset_if_it_sets_in_at_once_and_stays_for_three_ticks(
    differences, value
):
    offset = learnt(*differences)
    assert offset.value == pytest.approx(value, abs=0.06)


def test_an_offset_that_was_learnt_is_followed_slowly():
    offset = learnt(4.0, 4.0, 4.0)
    for count in range(1, 5):
        offset.learn(4.4, 1.0)
        assert offset.value == pytest.approx(4.0 + 0.05 * count)
    for _ in range(50):
        offset.learn(4.4, 1.0)
    assert offset.value == pytest.approx(4.4)
    for count in range(1, 5):
        offset.learn(4.0, 1.0)
        assert offset.value == pytest.approx(4.4 - 0.05 * count)


def test_what_is_further_off_than_half_a_move_is_under_way_and_not_learnt():
    offset = learnt(4.0, 4.0, 4.0, *(4.6,) * 50)
    assert offset.value == pytest.approx(4.0)
    assert learnt(4.0, 4.0, 4.0, *(4.5,) * 50).value == pytest.approx(4.5)


@pytest.mark.parametrize(("follows", "kept"), [(0, True), (1, False), (2, False), (3, True)])
def test_an_offset_outlasts_a_gap_only_if_the_drive_has_followed_for_three_ticks_since_the_gap_before(
    follows, kept
):
    offset = learnt(4.0, 4.0, 4.0)
    offset.interrupt()
    assert offset.value == 4.0
    if follows:
        for _ in range(follows):
            offset.learn(4.0, 1.0)
        offset.interrupt()
    assert offset.value == (4.0 if kept else 0.0)


def test_right_after_a_gap_no_difference_is_an_offset():
    offset = learnt()
    offset.interrupt()
    for _ in range(20):
        offset.learn(4.0, 1.0)
    assert offset.value == 0.0


def pushed_drives(push_kn, push_rpm, ticks=20):
    """What is known when the drives have followed for long and then are pushed."""
    in_force, limits = CommandInForce(), Limits()
    ordered = Command(80.0, 410.0)
    for count in range(ticks + 5):
        pushed = Command(80.0 + push_kn, 410.0 + push_rpm) if count >= ticks else ordered
        in_force.learn_offsets(Tick(count, 0.0, 0.08, ordered, drives=pushed), limits)
    return in_force


@pytest.mark.requirement("S12")
@pytest.mark.parametrize(("push_kn", "push_rpm"), [(4.0, 0.0), (0.0, -9.0), (-3.0, 12.0)])
def test_an_offset_is_subtracted_from_what_the_drives_report(push_kn, push_rpm):
    command = pushed_drives(push_kn, push_rpm).commanded(Command(80.0 + push_kn, 410.0 + push_rpm))
    assert (command.force_kn, command.speed_rpm) == pytest.approx((80.0, 410.0))


def test_differences_within_one_move_of_each_drive_are_not_an_offset():
    in_force = pushed_drives(1.0, 3.0)
    assert in_force.commanded(Command(81.0, 413.0)) == Command(81.0, 413.0)


@pytest.mark.parametrize("what", ["drives", "previous", "begun"])
def test_offset_is_not_learnt_without_command_or_feedback(what):
    in_force, limits = pushed_drives(0.0, 0.0), Limits()
    ordered, pushed = Command(80.0, 410.0), Command(84.0, 419.0)
    if what == "begun":
        in_force.begin_from(ordered)
    gap = Tick(
        99,
        0.0,
        0.08,
        None if what == "previous" else ordered,
        drives=None if what == "drives" else pushed,
    )
    in_force.learn_offsets(gap, limits)
    for count in range(5):
        in_force.learn_offsets(Tick(100 + count, 0.0, 0.08, ordered, drives=pushed), limits)
    assert in_force.commanded(pushed) == pushed


# ---------------------------------------------------------------- after a start or a gap


def new_start_up():
    """How control begins, with the command in force that it works on."""
    settings = SupervisorParameters.from_values(
        {"takeover_wait_s": 0.3, "first_report_wait_s": 1.5}
    )
    machine, in_force = Machine(settings), CommandInForce()
    registry = ControllerRegistry(machine, SafetyMonitor(machine), lockstep=False)
    registry.join("nmpc")
    registry.on_status("nmpc", ())
    return StartUp(machine, registry, None, in_force), in_force


def test_until_its_first_command_it_takes_who_was_selected_and_what_was_commanded():
    start_up, in_force = new_start_up()
    start_up.on_status("nmpc", False)
    assert start_up.was_active == ""
    start_up.on_status("nmpc", True)
    in_force.on_foreign(Command(81.0, 411.0))
    in_force.on_foreign(Command(float("nan"), 411.0))
    assert (start_up.was_active, in_force.seen) == ("nmpc", Command(81.0, 411.0))
    in_force.on_sent(Command(80.0, 410.0))
    start_up.on_status("decentral", True)
    in_force.on_foreign(Command(60.0, 310.0))
    assert (start_up.was_active, in_force.seen, in_force.before_first) == (
        "nmpc",
        Command(81.0, 411.0),
        False,
    )


def test_the_time_to_listen_counts_from_the_first_measurement():
    start_up, in_force = new_start_up()
    assert start_up.listening_ends_s is None
    start_up.begin(50.0)
    start_up.begin(51.0)
    assert start_up.listening_ends_s == 50.3
    in_force.on_sent(Command(80.0, 410.0))
    assert start_up.listening_ends_s is None


def test_at_a_gap_it_keeps_who_was_active_and_what_was_in_force():
    start_up, in_force = new_start_up()
    in_force.on_sent(Command(80.0, 410.0))
    start_up.machine.active = "nmpc"
    start_up.interrupt()
    known = (start_up.was_active, in_force.seen, in_force.applied, in_force.before_first)
    assert known == ("nmpc", Command(80.0, 410.0), None, False)
    start_up.machine.active = ""
    start_up.interrupt()
    assert (start_up.was_active, in_force.seen) == ("nmpc", Command(80.0, 410.0))


def test_after_a_gap_before_the_first_command_the_time_to_listen_begins_anew():
    start_up, _ = new_start_up()
    start_up.begin(50.0)
    start_up.interrupt()
    assert start_up.listening_ends_s is None
    start_up.begin(60.0)
    start_up.on_status("nmpc", True)
    assert (start_up.listening_ends_s, start_up.was_active) == (60.3, "nmpc")


def test_a_feedback_of_the_drives_that_is_not_finite_is_ignored():
    in_force = CommandInForce()
    assert not in_force.on_drives(1, Command(80.0, 410.0))
    assert in_force.on_drives(1, Command(81.0, 410.0)), "its stamp was seen before"
    assert not in_force.on_drives(2, Command(float("inf"), 410.0))
    assert (in_force.feedback(1), in_force.feedback(2)) == (Command(81.0, 410.0), None)


# ---------------------------------------------------------------- the check of a proposal


def test_a_proposal_is_checked_for_its_name_then_its_health_then_its_values():
    limits, before = Limits(), Command(80.0, 410.0)
    wrong = ProposalInput(
        1, "x" * 60, Command(120.0, 410.0), healthy=False, reason=Reason.of("ill")
    )
    refused = check("a", wrong, before, limits)
    assert (refused.refusal, refused.malformed, refused.jump) == (
        Reason(ReasonCode.OTHER_SOURCE, subject="x" * 40),
        True,
        False,
    )
    ill = check("a", ProposalInput(1, "a", Command(120.0, 410.0), healthy=False), before, limits)
    assert (ill.refusal, ill.malformed) == (Reason(ReasonCode.UNHEALTHY), False)
    ill = check(
        "a", ProposalInput(1, "a", Command(80.0, 410.0), False, Reason.of("ill")), before, limits
    )
    assert ill.refusal == Reason.of("ill")
    for command, jump in ((Command(120.0, 410.0), False), (Command(82.0, 410.0), True)):
        candidate = check("a", ProposalInput(1, "a", command), before, limits)
        assert (candidate.command, bool(candidate.refusal), candidate.malformed) == (
            command,
            True,
            True,
        )
        assert candidate.jump == jump
    good = check("a", ProposalInput(1, "a", Command(82.0, 410.0)), None, limits)
    assert (good.refusal, good.malformed, good.jump, good.command) == (
        Reason(),
        False,
        False,
        Command(82.0, 410.0),
    )


def test_commands_are_the_same_but_for_rounding():
    first = Command(80.0, 410.0)
    assert same(first, Command(80.0 * (1 + 5e-10), 410.0 * (1 - 5e-10)))
    assert not same(first, Command(80.0 * (1 + 5e-9), 410.0))
    assert not same(first, Command(80.0, 410.0 * (1 + 5e-9)))


@pytest.mark.parametrize("stalled", [True, False])
@pytest.mark.parametrize("sampled", [True, False])
def test_faults_are_excused_if_the_supervisor_was_held_up_or_no_sensor_sample_has_arrived(
    stalled, sampled
):
    tick = Tick(1, 0.0, 0.08, None, samples={"depth": 2.6} if sampled else {}, stalled=stalled)
    assert bool(tick.excuse) == (stalled or not sampled)
    reason = tick.excuse
    tick = tick.settle()
    assert tick.outcome == Outcome(None, reason)
    tick = tick._replace(stalled=not stalled, samples={})
    assert tick.excuse == reason, "settled with the decision"


def test_an_excuse_of_the_decision_counts_before_others():
    tick = Tick(1, 0.0, 0.08, None, stalled=True)
    excuse = Reason(ReasonCode.INCOMPLETE, ("torque",))
    tick = tick.settle(SENT, excuse)
    assert tick.outcome == Outcome(SENT, excuse)
    assert tick.excuse == excuse
