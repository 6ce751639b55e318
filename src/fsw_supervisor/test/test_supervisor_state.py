"""The state that an operator sees.

How a transition is told, what counts as a swap, and the settings behind it.
"""

import pytest

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_control.stop import Stop
from fsw_supervisor.facts import Code, Fact
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import (
    TRANSITIONS,
    Event,
    Level,
    Machine,
    Mode,
    Standing,
    next_mode,
)


@pytest.fixture
def machine():
    """A machine at tick 1, before its first transition."""
    machine = Machine(
        SupervisorParameters.from_values(
            {"transition_ticks": 7, "storm_swaps": 2, "storm_window_s": 1.0}
        )
    )
    machine.advance(100)
    return machine


def ticks(machine, count):
    for _ in range(count):
        machine.advance(machine.tick * 1000)
    return machine


def test_it_begins_in_start_with_what_is_configured():
    machine = Machine(SupervisorParameters.from_values({"controller": "nmpc"}))
    assert (machine.mode, machine.target_mode, machine.active, machine.target) == (
        Mode.START,
        Mode.AUTO,
        "",
        "nmpc",
    )
    assert (
        machine.transitions,
        machine.revision,
        machine.tick,
        machine.slewing,
        machine.since_ns,
    ) == (0, 0, 0, 0, 0)
    assert (machine.acknowledged, machine.cause, list(machine.events)) == (
        False,
        Cause.STARTED,
        [],
    )
    assert machine.reason.code is ReasonCode.NO_MEASUREMENT
    assert not machine.storming()


def test_a_transition_is_told_with_who_why_when_and_the_controller(machine):
    ticks(machine, 5)
    machine.advance(4200)
    machine.fire(Cause.READY, Reason.of("it is ready"), "start", "nmpc")
    assert (machine.mode, machine.active, machine.slewing) == (Mode.AUTO, "nmpc", 7)
    assert (machine.reason, machine.cause, machine.since_ns) == (
        Reason.of("it is ready"),
        Cause.READY,
        4200,
    )
    assert (machine.transitions, machine.ticks_in_mode) == (1, 0)
    fact = Fact.of(
        Code.MODE_WITH,
        reason=Reason.of("it is ready"),
        before="start",
        mode="auto",
        controller="nmpc",
    )
    assert machine.events[-1] == Event(Level.INFO, "start", fact)
    assert machine.revision == 1
    ticks(machine, 3)
    machine.fire(Cause.INTERLOCK_TRIP, Reason.of("too hot"), "interlock", "nmpc")
    assert (machine.mode, machine.active, machine.slewing) == (Mode.SAFE_STOP, "", 0)
    fact = Fact.of(Code.MODE, reason=Reason.of("too hot"), before="auto", mode="safe_stop")
    assert machine.events[-1] == Event(Level.ERROR, "interlock", fact)
    assert (machine.transitions, machine.ticks_in_mode) == (2, 0)
    assert ticks(machine, 4).ticks_in_mode == 4


def test_a_trigger_that_the_table_does_not_have_changes_nothing(machine):
    machine.fire(Cause.STORM, Reason.of("a storm"), "failover")
    assert (machine.mode, machine.transitions, machine.revision) == (Mode.START, 0, 0)


@pytest.mark.parametrize("row", TRANSITIONS, ids=lambda row: f"{row.source}-{row.trigger}")
def test_each_row_of_the_table_is_followed_and_says_when(row):
    assert next_mode(row.source, row.trigger) is row.target
    assert row.source is not row.target
    assert row.meaning


@pytest.mark.parametrize(
    ("trigger", "target", "sources"),
    [
        (Cause.OPERATOR_AUTO, Mode.AUTO, set(Mode) - {Mode.AUTO}),
        (Cause.OPERATOR_MANUAL, Mode.MANUAL, set(Mode) - {Mode.MANUAL}),
        (Cause.OPERATOR_HOLD, Mode.HOLD, set(Mode) - {Mode.HOLD}),
        (Cause.OPERATOR_SAFE_STOP, Mode.SAFE_STOP, set(Mode) - {Mode.SAFE_STOP}),
        (Cause.RESTARTED, Mode.SAFE_STOP, set(Mode) - {Mode.SAFE_STOP}),
        (Cause.INTERLOCK_TRIP, Mode.SAFE_STOP, set(Mode) - {Mode.SAFE_STOP}),
        (Cause.READY, Mode.AUTO, {Mode.START}),
        (Cause.ABANDONED, Mode.HOLD, {Mode.START}),
        (Cause.START_TIMEOUT, Mode.SAFE_STOP, {Mode.START}),
        (Cause.INTERRUPTED, Mode.START, {Mode.AUTO}),
        (Cause.NO_CONTROLLER, Mode.HOLD, {Mode.AUTO}),
        (Cause.STORM, Mode.HOLD, {Mode.AUTO}),
        (Cause.CONTROLLER_BACK, Mode.AUTO, {Mode.HOLD}),
        (Cause.HOLD_TIMEOUT, Mode.SAFE_STOP, {Mode.HOLD}),
        (Cause.BLIND_TIMEOUT, Mode.SAFE_STOP, {Mode.MANUAL}),
    ],
)
def test_each_trigger_leads_from_where_it_may_to_one_mode(trigger, target, sources):
    rows = [row for row in TRANSITIONS if row.trigger is trigger]
    assert {row.target for row in rows} == {target}
    assert {row.source for row in rows} == sources


def test_swaps_that_nobody_asked_for_make_a_storm_within_the_window(machine):
    machine.fire(Cause.READY, Reason(), "start", "a")
    requested, failed = Cause.SWAP_REQUESTED, Cause.SWAP_FAILED
    for name, cause in (("b", requested), ("a", requested), ("b", failed)):
        machine.swap(name, cause, Reason.of("why"), "who")
        assert (machine.active, machine.slewing, machine.storming()) == (name, 7, False)
    fact = Fact.of(Code.SWAP, reason=Reason.of("why"), before="a", controller="b")
    assert machine.events[-1] == Event(Level.INFO, "who", fact)
    ticks(machine, 5)
    machine.swap("a", failed, Reason.of("why"), "who")
    assert machine.storming()
    ticks(machine, 4)
    assert machine.storming()
    ticks(machine, 1)
    assert not machine.storming(), "the first of the two was 10 ticks ago"


def test_coming_back_from_hold_counts_as_an_automatic_swap_and_starting_does_not(machine):
    machine.fire(Cause.READY, Reason(), "start", "a")
    machine.swap("b", Cause.SWAP_FAILED, Reason(), "failover")
    machine.fire(Cause.NO_CONTROLLER, Reason(), "failover")
    assert not machine.storming()
    machine.fire(Cause.CONTROLLER_BACK, Reason(), "failover", "a")
    assert machine.storming()


def test_without_a_limit_there_is_no_storm():
    machine = Machine(SupervisorParameters.from_values({"storm_swaps": 0}))
    machine.fire(Cause.READY, Reason(), "start", "a")
    assert not machine.storming()
    machine.swap("b", Cause.SWAP_FAILED, Reason(), "failover")
    assert not machine.storming()


def test_what_an_operator_sees_changes_the_revision_only_when_it_changes(machine):
    for call, changes in (
        (lambda: machine.explain(Reason.of("because")), True),
        (lambda: machine.explain(Reason.of("because")), False),
        (lambda: machine.set_target("nmpc"), True),
        (lambda: machine.set_target("nmpc"), False),
        (lambda: machine.set_target(mode=Mode.HOLD), True),
        (lambda: machine.set_target(), False),
        (lambda: machine.set_target("nmpc", Mode.HOLD), False),
        (lambda: machine.log(Level.INFO, "a", "b"), True),
        (lambda: machine.merge_stop(Stop(1, True)), True),
        (lambda: machine.merge_stop(Stop(1, True)), False),
        (machine.renew, False),
        (lambda: machine.acknowledge("anna"), True),
        (lambda: machine.acknowledge("anna"), False),
        (machine.renew, True),
    ):
        before = machine.revision
        call()
        assert (machine.revision > before) == changes
    assert (machine.target, machine.target_mode, machine.mode) == (
        "nmpc",
        Mode.HOLD,
        Mode.SAFE_STOP,
    )


def test_to_renew_a_mode_begins_its_time_anew(machine):
    ticks(machine, 5)
    assert machine.ticks_in_mode == 6
    machine.renew()
    assert (machine.ticks_in_mode, machine.mode) == (0, Mode.START)


def test_the_transition_limits_end_after_their_ticks_or_on_arrival(machine):
    machine.fire(Cause.READY, Reason(), "start", "a")
    machine.slew(arrived=False)
    assert machine.slewing == 6
    machine.slew(arrived=True)
    assert machine.slewing == 0


@pytest.mark.parametrize(
    ("source", "mode", "active"),
    [
        ("nmpc", Mode.AUTO, "nmpc"),
        ("hold", Mode.HOLD, ""),
        ("manual", Mode.MANUAL, ""),
        ("safe_stop", Mode.SAFE_STOP, ""),
    ],
)
def test_a_standby_is_in_the_mode_in_which_the_leader_commands(machine, source, mode, active):
    ticks(machine, 5)
    for _ in range(3):
        machine.mirror(source)
        assert (machine.mode, machine.active) == (mode, active)
    assert machine.ticks_in_mode == 0
    assert ticks(machine, 2).ticks_in_mode == 2
    machine.mirror(source)
    assert machine.ticks_in_mode == 2, "the time counts from when it began"
    assert machine.transitions == 0


def test_a_standby_notes_the_leaders_swap_without_beginning_the_mode_anew(machine):
    machine.mirror("nmpc")
    ticks(machine, 3)
    machine.mirror("decentral")
    assert (machine.active, machine.ticks_in_mode) == ("decentral", 3)


def test_a_standby_that_leads_tells_so_and_slews(machine):
    machine.mirror_standing(
        Standing(
            "auto",
            "nmpc",
            Cause.SWAP_REQUESTED,
            Reason(ReasonCode.REQUESTED, subject="nmpc"),
            "anna",
        )
    )
    machine.mirror("nmpc")
    machine.lead(3)
    assert (machine.slewing, machine.cause, machine.who) == (7, Cause.SWAP_REQUESTED, "anna")
    assert machine.reason.code is ReasonCode.REQUESTED, "a takeover changes who leads, not why"
    assert machine.events[-1].who == "takeover"
    assert machine.events[-1].fact == Fact.of(Code.LEADS, mode="auto", ticks=3)


def test_takeovers_again_and_again_leave_the_reason_as_it_is(machine):
    reported = Standing("hold", "", Cause.NO_CONTROLLER, Reason(ReasonCode.NO_FALLBACK))
    for _ in range(3):
        machine.mirror_standing(reported)
        machine.mirror("hold")
        machine.lead(3)
        assert (machine.cause, machine.reason) == (reported.cause, reported.reason)
    machine.mirror("nmpc")
    machine.lead(2)
    assert (machine.cause, machine.reason) == (Cause.UNKNOWN, Reason()), (
        "the leader died before it told why"
    )


# ---------------------------------------------------------------- settings


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"limits.force_min_kn": 95.0, "limits.force_max_kn": 95.0}, "force_min"),
        ({"limits.speed_min_rpm": 500.0, "limits.speed_max_rpm": 500.0}, "speed_min"),
        ({"deadline_s": 0.1}, "deadline_s is 0.1 s"),
        ({"safe_force_kn": 59.9}, "safe_force_kn must be within"),
        ({"safe_force_kn": 95.1}, "safe_force_kn must be within"),
    ],
)
def test_settings_at_the_edge_of_what_makes_no_sense_are_refused(values, words):
    with pytest.raises(ValueError, match=words):
        SupervisorParameters.from_values(values)


@pytest.mark.parametrize(
    "values",
    [
        {"safe_force_kn": 60.0},
        {"safe_force_kn": 95.0},
        {"force_transition_kn": 1.0, "speed_transition_rpm": 3.0},
        {"fallbacks": ()},
    ],
)
def test_settings_at_the_edge_of_what_makes_sense_are_taken(values):
    settings = SupervisorParameters.from_values(values)
    assert {name: getattr(settings, name) for name in values} == values


def test_limits_that_are_set_are_the_ones_that_hold():
    values = {
        "force_min_kn": 61.0,
        "force_max_kn": 94.0,
        "speed_min_rpm": 310.0,
        "speed_max_rpm": 490.0,
    }
    values |= {"force_step_kn": 2.0, "speed_step_rpm": 4.0}
    limits = SupervisorParameters.from_values(
        {f"limits.{name}": value for name, value in values.items()}
    ).drive_limits
    assert {name: getattr(limits, name) for name in values} == values
    assert limits.clip(Command(0.0, 0.0), None) == Command(61.0, 310.0)


def test_settings_whose_limits_were_used_can_be_changed():
    settings = SupervisorParameters()
    assert settings.drive_limits.force_max_kn == settings.limits.force_max_kn
    changed = settings.changed(limits=settings.limits.changed(force_max_kn=90.0))
    assert changed.drive_limits.force_max_kn == 90.0
    assert settings.flat() == SupervisorParameters().flat()


def test_a_leader_is_given_time_to_decide_before_its_tick_counts_as_unanswered():
    settings = SupervisorParameters.from_values({"deadline_s": 0.06, "lockstep_deadline_s": 2.0})
    assert settings.takeover_s(lockstep=False) == pytest.approx(0.09)
    assert settings.takeover_s(lockstep=True) == pytest.approx(4.0)
