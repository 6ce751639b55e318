"""Who leads: how long a supervisor listens first, what it hears of another one, and when it is woken."""

import pytest

from fsw_control.contract import Command
from fsw_control.fence import ActuatorState, Fence, Signature
from fsw_control.stop import Stop, StopCause
from fsw_supervisor.failover import LISTEN_S, Role
from fsw_supervisor.state_machine import Mode

TICK_NS = 100_000_000
OTHER = Signature(1, "other")
HELD = Command(80.0, 410.0)


def answer(standby, source="nmpc", command=HELD, signature=OTHER):
    """Let another leader answer the present tick, heard by the actuator end and by the standby."""
    if standby.fence.check(signature, source) is None:
        standby.fence.take(source, standby.stamp_ns)
    standby.failover.on_command(signature, standby.stamp_ns, source, command)


@pytest.mark.parametrize(("others", "listens_s"), [(False, 0.25), (True, 1.0)])
def test_it_leads_when_it_has_heard_of_nobody_for_a_while(make_leader, others, listens_s):
    """Longer while somebody else publishes commands.

    Perhaps a leader that has not been heard yet.
    """
    leader = make_leader()
    leader.failover.rival_writer = others
    assert leader.failover.wakeup_s == pytest.approx(leader.now_s + listens_s)
    leader.run(listens_s - 0.01)
    assert leader.failover.role is Role.LISTENING
    leader.run(0.02)
    assert leader.failover.role is Role.ACTIVE
    assert leader.arbiter.machine.transitions == 0, "a start is no takeover"
    assert leader.tick(5).sent[-1].source == "decentral"
    assert leader.failover.signature[:2] == (1, "m")


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("lockstep", [False, True])
def test_standby_leads_when_it_hears_of_nobody_and_nothing_is_measured(make_leader, lockstep):
    """The plant may wait for a publisher of commands before its first tick."""
    standby = make_leader(standby=True, lockstep=lockstep)
    standby.run(4.99)
    assert standby.failover.role is Role.STANDBY
    standby.run(0.02)
    assert standby.failover.role is Role.ACTIVE
    assert standby.arbiter.machine.transitions == 0, "a start is no takeover"
    assert standby.tick(5).sent[-1].source == "decentral"


@pytest.mark.requirement("S9")
def test_standby_waits_for_a_slow_leader_before_the_first_measurement(make_leader):
    standby = make_leader(standby=True)
    standby.failover.rival_writer = True  # its publisher is there, its state has not arrived
    standby.run(60.0)
    assert standby.failover.role is Role.STANDBY
    standby.failover.rival_writer = False
    standby.failover.on_leader_state(OTHER)
    standby.call([])
    standby.run(4.9)
    assert standby.failover.role is Role.STANDBY
    standby.run(0.2)
    assert standby.failover.role is Role.ACTIVE, "the leader died before the first measurement"


@pytest.mark.requirement("S9")
def test_standby_that_was_stalled_has_not_listened(make_leader):
    """Its start may last long on a busy machine; a leader is not discovered by then."""
    standby = make_leader(standby=True)
    standby.sleep(20.0)
    standby.run(0.0).run(4.9)
    assert standby.failover.role is Role.STANDBY
    standby.run(0.2)
    assert standby.failover.role is Role.ACTIVE


@pytest.mark.requirement("S9", "S25")
def test_nothing_is_sent_before_the_actuator_end_has_reported(make_leader):
    leader = make_leader()
    leader.fence = None
    leader.run(2 * LISTEN_S).tick(10)
    assert (leader.failover.role, leader.failover.term, leader.sent) == (Role.ACTIVE, 0, [])
    leader.fence = Fence()
    assert leader.tick(5).sent[-1].source == "decentral"


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("term", [1, 2, 41])
def test_a_fresh_supervisor_takes_a_term_above_the_one_that_is_reported(make_leader, term):
    """The leader before is suspended or dead; if it continues, its commands are refused."""
    leader = make_leader()
    old = Signature(term, "other")
    leader.fence.check(old, "nmpc")
    for _ in range(5):
        leader.fence.measure()
    leader.run(2 * LISTEN_S).tick(5)
    assert leader.failover.signature[:2] == (term + 1, "m")
    assert leader.fence.check(old, "nmpc").code == "leader"


@pytest.mark.requirement("S25")
def test_a_fresh_supervisor_learns_a_safe_stop_from_the_actuator_end(make_leader):
    leader = make_leader()
    leader.fence.register.merge(Stop(7, True, StopCause.OPERATOR, "anna"))
    leader.run(2 * LISTEN_S).tick(5)
    assert {decision.source for decision in leader.sent} == {"safe_stop"}
    assert leader.arbiter.machine.register.value == Stop(7, True, StopCause.OPERATOR, "anna")


@pytest.mark.requirement("S25")
def test_a_safe_stop_that_was_acknowledged_but_not_left_outlasts_a_restart(make_leader):
    leader = make_leader()
    leader.fence.register.merge(Stop(8, False, StopCause.OPERATOR, "anna"))
    leader.fence.take("safe_stop", leader.stamp_ns)
    leader.run(2 * LISTEN_S).tick(5)
    assert {decision.source for decision in leader.sent} == {"safe_stop"}
    assert leader.arbiter.machine.acknowledged


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("ticks", [1, 2, 5])
def test_a_standby_takes_over_with_the_last_of_the_ticks_that_nobody_answers(make_leader, ticks):
    standby = make_leader(standby=True, takeover_ticks=ticks).run(3.0)
    assert (standby.failover.role, standby.sent, standby.failover.asserting) == (
        Role.STANDBY,
        [],
        False,
    )
    for _ in range(ticks - 1):
        standby.tick()
        assert standby.failover.role is Role.STANDBY
    standby.tick()
    assert standby.failover.role is Role.ACTIVE


@pytest.mark.requirement("S9")
def test_a_leader_that_is_heard_here_but_not_at_the_actuator_end_is_replaced(make_leader):
    standby = make_leader(standby=True)
    for _ in range(4):
        standby.measure()
        standby.failover.on_command(OTHER, standby.stamp_ns, "nmpc", HELD)
        standby.run(0.1)
    assert standby.failover.role is Role.ACTIVE


@pytest.mark.requirement("S9")
def test_each_recent_takeover_doubles_the_patience_of_a_standby(make_leader):
    patience = []
    standby = make_leader(standby=True)
    for term in range(1, 6):
        standby.measure()
        answer(standby, signature=Signature(10 * term, f"other{term}"))
        standby.run(0.1)
        standby.tick()
        ticks = 1
        while standby.failover.role is Role.STANDBY:
            standby.tick()
            ticks += 1
        patience.append(ticks)
        standby.measure()
        standby.failover.on_actuator(ActuatorState(10 * term + 5, "third"), standby.now_s)
        assert standby.failover.role is Role.STANDBY
    assert patience == sorted(patience) and patience[0] <= 4 and patience[-1] == 16


@pytest.mark.requirement("S11")
@pytest.mark.parametrize(
    "signature", [Signature(), Signature(5, ""), Signature(0, "m"), Signature(9, "m")]
)
def test_unsigned_state_changes_no_role(leader, signature):
    assert not leader.failover.on_leader_state(signature)
    assert leader.failover.role is Role.ACTIVE


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("term", [0, 1, 2, 99])
def test_a_leader_that_the_actuator_end_confirms_stays_whoever_claims_to_lead(leader, term):
    assert not leader.failover.on_leader_state(Signature(term, "z"))
    assert leader.failover.asserting
    leader.failover.on_command(Signature(term, "z"), leader.stamp_ns, "nmpc", Command(81.0, 412.0))
    assert (leader.failover.role, leader.arbiter.applied) == (Role.ACTIVE, HELD)


@pytest.mark.requirement("S9")
@pytest.mark.parametrize(("term", "stays"), [(0, True), (1, False), (2, False)])
def test_a_leader_steps_down_when_another_one_is_reported(leader, term, stays):
    leader.failover.on_actuator(ActuatorState(term, "z"), leader.now_s)
    assert (leader.failover.role is Role.ACTIVE) == stays, "a report of an earlier term is old"


@pytest.mark.parametrize("identity", ["a", "z"])
def test_between_two_leaders_of_one_term_the_actuator_end_decides(make_leader, identity):
    leader = make_leader().run(2 * LISTEN_S)
    while not leader.sent:
        leader.measure()
        leader.run(0.09)
    rival = Signature(1, identity)
    assert (leader.failover.term, leader.failover.leads) == (1, False), "no report yet"
    assert not leader.failover.on_leader_state(rival)
    assert leader.failover.role is Role.ACTIVE
    other = Fence()
    assert other.check(rival, "nmpc") is None
    leader.failover.on_actuator(other.state, leader.now_s)
    assert leader.failover.role is Role.STANDBY


@pytest.mark.parametrize(("identity", "stays"), [("a", True), ("z", False)])
def test_before_any_report_the_greater_identity_stays(make_leader, identity, stays):
    leader = make_leader().run(2 * LISTEN_S)
    assert leader.failover.on_leader_state(Signature(0, identity)) is not stays
    assert (leader.failover.role is Role.ACTIVE) == stays


@pytest.mark.parametrize("by_command", [True, False])
def test_while_it_listens_a_leader_makes_it_the_standby(make_leader, by_command):
    listener = make_leader()
    listener.measure()
    if by_command:
        answer(listener, command=Command(80.5, 410.0))
    else:
        assert listener.failover.on_leader_state(OTHER)
    assert listener.failover.role is Role.STANDBY
    assert listener.run(3.0).sent == []


def test_commands_of_its_own_are_not_foreign(leader):
    own = leader.sent[-1]
    leader.failover.on_command(leader.failover.signature, own.stamp_ns, own.source, own.command)
    assert leader.arbiter.watch.foreign_commands == 0
    leader.failover.on_command(Signature(0, "other"), own.stamp_ns, own.source, own.command)
    assert (leader.arbiter.watch.foreign_commands, len(leader.facts("foreign_command"))) == (
        1,
        0,
    )
    leader.failover.on_command(Signature(), own.stamp_ns, own.source, own.command)
    assert (leader.arbiter.watch.foreign_commands, len(leader.facts("foreign_command"))) == (
        2,
        1,
    )


def test_the_same_command_of_the_leader_before_does_not_make_the_own_one_foreign(leader):
    """In a takeover both answer a tick, mostly alike; the own command is heard second."""
    own = leader.sent[-1]
    for signature in (Signature(0, "other"), leader.failover.signature):
        leader.failover.on_command(signature, own.stamp_ns, own.source, own.command)
    assert (leader.arbiter.watch.foreign_commands, len(leader.facts("foreign_command"))) == (
        0,
        0,
    )
    leader.failover.on_command(leader.failover.signature, own.stamp_ns, own.source, own.command)
    assert len(leader.facts("foreign_command")) == 1, "repeated, it is another writer's"


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("age_ticks", [0, 10])
def test_a_standby_takes_over_what_the_leader_has_commanded_lately(make_leader, age_ticks):
    standby = make_leader(standby=True)
    standby.measure()
    standby.failover.on_command(
        OTHER, standby.stamp_ns - age_ticks * TICK_NS, "nmpc", Command(81.0, 412.0)
    )
    assert standby.arbiter.applied == Command(81.0, 412.0)
    standby.failover.on_command(
        OTHER, standby.stamp_ns - 11 * TICK_NS, "nmpc", Command(60.0, 310.0)
    )
    assert standby.arbiter.applied == Command(81.0, 412.0)


@pytest.mark.requirement("S9")
def test_a_standby_does_not_follow_a_leader_of_an_earlier_term(make_leader):
    standby = make_leader(standby=True)
    standby.measure()
    answer(standby, signature=Signature(3, "new"))
    standby.failover.on_command(
        Signature(2, "old"), standby.stamp_ns, "nmpc", Command(70.0, 350.0)
    )
    assert standby.arbiter.applied == HELD


@pytest.mark.requirement("S9")
def test_a_command_that_overtakes_its_measurement_counts_as_the_answer(make_leader):
    standby = make_leader(standby=True)
    for _ in range(20):
        stamp_ns = standby.stamp_ns + TICK_NS
        standby.failover.on_command(OTHER, stamp_ns, "nmpc", Command(81.0, 412.0))
        standby.measure()
        standby.fence.check(OTHER, "nmpc")
        standby.run(0.1)
        assert standby.arbiter.ticks.present.stamp_ns == stamp_ns
        assert standby.arbiter.applied == Command(81.0, 412.0)
        assert standby.failover.unanswered == 0
    assert (standby.failover.role, standby.sent) == (Role.STANDBY, [])


def test_a_command_to_a_measurement_that_never_came_answers_no_other(make_leader):
    standby = make_leader(standby=True)
    standby.measure()
    answer(standby)
    standby.run(0.1)
    standby.failover.on_command(
        OTHER, standby.stamp_ns + TICK_NS // 2, "nmpc", Command(60.0, 310.0)
    )
    standby.tick(6)
    assert standby.failover.role is Role.ACTIVE
    assert standby.sent[0].command == HELD


@pytest.mark.requirement("S9")
def test_a_standby_that_has_missed_measurements_takes_over_from_the_drives(make_leader):
    standby = make_leader(standby=True, takeover_ticks=1)
    standby.measure()
    answer(standby)
    standby.run(0.1)
    for force_kn in (81.0, 82.0, 83.0, 84.0):
        standby.stamp_ns += TICK_NS
        standby.fence.measure()
        answer(standby, command=Command(force_kn, 410.0))
        standby.run(0.1)
    standby.drives = Command(84.0, 410.0)
    standby.tick(5)
    assert standby.failover.role is Role.ACTIVE
    assert standby.sent[0].command.force_kn >= 83.0


@pytest.mark.requirement("S9")
def test_a_new_term_begins_above_each_that_was_heard(make_leader):
    standby = make_leader(standby=True)
    standby.failover.on_leader_state(Signature(7, "other"))
    standby.measure()
    standby.failover.on_command(Signature(9, "other"), standby.stamp_ns, "nmpc", HELD)
    standby.tick(4)
    assert standby.failover.signature[:2] == (10, "m")


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_standby_is_woken_when_the_leaders_answer_is_overdue(make_leader, lockstep):
    standby = make_leader(standby=True, lockstep=lockstep, takeover_ticks=1)
    standby.measure()
    assert standby.sent == []
    due_s = standby.now_s + (2.0 if lockstep else standby.arbiter.settings.takeover_s(lockstep))
    while standby.sent == []:
        at_s = standby.failover.wakeup_s
        assert at_s is not None
        assert standby.now_s < at_s <= due_s + 1e-9
        standby.now_s = at_s
        standby.call(standby.arbiter.on_time(at_s))
    assert standby.now_s == pytest.approx(due_s)
    assert standby.failover.role is Role.ACTIVE


def test_nothing_is_waited_for_in_a_tick_that_the_leader_has_answered(make_leader):
    standby = make_leader(standby=True)
    standby.measure()
    answer(standby)
    standby.run(0.001)
    assert standby.failover.wakeup_s is None


@pytest.mark.requirement("S9")
def test_a_standby_that_was_held_up_hears_what_is_in_its_queues_before_it_takes_over(make_leader):
    standby = make_leader(standby=True, takeover_ticks=1)
    standby.measure()
    standby.sleep(0.5)
    standby.run(0.0)
    assert standby.failover.role is Role.STANDBY
    assert standby.failover.wakeup_s == pytest.approx(standby.now_s + 0.03)
    standby.run(0.02)
    standby.failover.on_command(Signature(0, "other"), standby.stamp_ns, "nmpc", HELD)
    standby.run(0.05)
    assert standby.failover.role is Role.STANDBY, "the answer was in the queue"


def test_in_lockstep_a_standby_does_not_wait_out_the_deadlines_for_what_it_has_decided(
    make_leader,
):
    """With those of a graph it took over after 60 s, when the plant gave up."""
    patient = {"lockstep_deadline_s": 30.0, "lockstep_shadow_wait_s": 30.0}
    standby = make_leader(standby=True, lockstep=True, **patient)
    standby.measure()
    standby.run(1.9)
    assert standby.failover.role is Role.STANDBY
    standby.run(0.2)
    assert standby.failover.role is Role.ACTIVE
    assert [decision.stamp_ns for decision in standby.sent] == [standby.stamp_ns]


def test_in_lockstep_a_leader_that_answers_in_time_stays(make_leader):
    standby = make_leader(standby=True, lockstep=True, lockstep_deadline_s=30.0)
    for _ in range(5):
        standby.measure()
        standby.run(0.9)
        answer(standby)
    assert standby.failover.role is Role.STANDBY


@pytest.mark.requirement("S9")
def test_in_lockstep_a_leader_that_repeats_its_state_stays_and_a_silent_one_does_not(make_leader):
    """It may wait for a controller that has answered the standby."""
    standby = make_leader(standby=True, lockstep=True)
    standby.fence.check(OTHER, "nmpc")
    standby.measure()
    for _ in range(20):
        standby.run(1.7)
        assert standby.failover.role is Role.STANDBY
        assert standby.failover.on_leader_state(OTHER)
        standby.run(0.0)
    standby.run(1.9)
    assert standby.failover.role is Role.STANDBY
    standby.run(0.2)
    assert standby.failover.role is Role.ACTIVE
    assert standby.arbiter.machine.mode is Mode.AUTO


@pytest.mark.requirement("S9")
def test_in_lockstep_a_standby_is_more_patient_after_a_takeover(make_leader):
    standby = make_leader(standby=True, lockstep=True)
    for term in (1, 2):
        standby.measure()
        answer(standby, signature=Signature(term, f"other{term}"))
        standby.run(0.1)
    standby.measure()
    standby.run(3.9)
    assert standby.failover.role is Role.STANDBY
    standby.run(0.2)
    assert standby.failover.role is Role.ACTIVE


@pytest.mark.requirement("S9")
def test_in_lockstep_an_answer_that_reached_the_standby_alone_is_given_again(make_leader):
    """Of a leader that was killed between the one and the other.

    The plant sends its tick again.
    """
    standby = make_leader(
        standby=True, lockstep=True, lockstep_deadline_s=30.0, lockstep_shadow_wait_s=30.0
    )
    for _ in range(3):
        standby.measure()
        standby.run(0.05)
        answer(standby)
    standby.measure()
    standby.run(0.05)
    standby.failover.on_command(OTHER, standby.stamp_ns, "nmpc", HELD)
    standby.run(3.0)
    assert standby.failover.role is Role.STANDBY, "as far as it knows the tick is answered"
    standby.call(standby.arbiter.on_drives(standby.stamp_ns, standby.drives, standby.now_s))
    standby.run(3.0)
    assert standby.failover.role is Role.ACTIVE
    assert [decision.stamp_ns for decision in standby.sent] == [standby.stamp_ns]


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("first", [None, "depth"])
def test_in_lockstep_the_tick_that_stood_when_a_leader_was_killed_is_answered(make_leader, first):
    """Whatever of its measurement comes first.

    A sample, or the report which names the leader that is dead.
    """
    fresh = make_leader(lockstep=True, lockstep_deadline_s=30.0, lockstep_shadow_wait_s=30.0)
    fresh.fence.check(OTHER, "nmpc")
    fresh.fence.take("nmpc", fresh.stamp_ns)
    fresh.run(2 * LISTEN_S)
    assert fresh.failover.role is Role.ACTIVE
    if first is not None:
        fresh.call(fresh.arbiter.on_sample(first, fresh.stamp_ns + TICK_NS, 2.66, fresh.now_s))
    fresh.measure()
    assert fresh.failover.role is Role.STANDBY
    fresh.run(3.0)
    assert fresh.failover.role is Role.ACTIVE
    assert [decision.stamp_ns for decision in fresh.sent] == [fresh.stamp_ns]
    assert (fresh.fence.state.leader, fresh.fence.state.term) == ("m", 2)


@pytest.mark.requirement("S9")
def test_commands_that_do_not_arrive_for_three_ticks_begin_again_from_the_drives(
    leader, monkeypatch
):
    """Not one move further per lost command: the first that arrives would be a jump."""
    monkeypatch.setattr(leader.fence, "check", lambda signature, source: ("lost", ""))
    leader.wish = Command(90.0, 410.0)
    leader.tick(10)
    assert (
        max(decision.command.force_kn for decision in leader.sent) <= leader.drives.force_kn + 4.0
    )
    assert leader.sent[-1].command.force_kn == leader.drives.force_kn + 1.0
    assert len(leader.facts("taking_over")) <= 2, "one message for the ticks in a row"


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("source", ["decentral", "safe_stop"])
def test_after_the_actuator_ends_own_ramp_a_safe_stop_does_not_raise_the_force(leader, source):
    leader.fence.take(source, leader.stamp_ns)
    leader.fence.stop(StopCause.WATCHDOG, leader.stamp_ns)
    leader.drives = Command(70.0, 410.0)
    leader.tick()
    assert leader.sent[-1].source == "safe_stop"
    assert 69.0 <= leader.sent[-1].command.force_kn <= 70.0


@pytest.mark.requirement("S25")
@pytest.mark.parametrize(("force_kn", "stops"), [(80.0, False), (79.2, False), (77.0, True)])
def test_a_fresh_actuator_end_whose_drives_have_moved_begins_a_safe_stop(leader, force_kn, stops):
    leader.fence = Fence()
    leader.drives = Command(force_kn, 410.0)
    leader.tick(2)
    register = leader.arbiter.machine.register
    assert (register.stopped, register.value.cause is StopCause.WATCHDOG) == (stops, stops)
    assert (leader.sent[-1].source == "safe_stop") == stops


@pytest.mark.requirement("S9")
def test_a_standby_that_has_sent_nothing_yet_gives_way_to_a_leader_that_answers_again(leader):
    leader.failover.term = 0
    answers = Fence()
    assert answers.check(OTHER, "nmpc") is None
    answers.measure()
    leader.failover.on_actuator(answers.state, leader.now_s)
    assert leader.failover.role is Role.STANDBY
