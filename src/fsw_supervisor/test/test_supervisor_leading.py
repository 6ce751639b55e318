"""Who leads: how long a supervisor listens first, what it hears of another one, and when it is woken."""

import pytest

from fsw_control.contract import Command
from fsw_supervisor.failover import LISTEN_S, Role
from fsw_supervisor.state_machine import Mode

TICK_NS = 100_000_000


@pytest.mark.parametrize(("others", "listens_s"), [(False, 0.25), (True, 1.0)])
def test_it_leads_when_it_has_heard_of_nobody_for_a_while(make_leader, others, listens_s):
    """Longer while somebody else publishes commands: perhaps a leader that has not been heard yet."""
    leader = make_leader()
    leader.failover.rival_writer = others
    assert leader.failover.wakeup_s == pytest.approx(leader.now_s + listens_s)
    leader.run(listens_s - 0.01)
    assert leader.failover.role is Role.LISTENING
    leader.run(0.02)
    assert leader.failover.role is Role.ACTIVE
    assert leader.failover.token == "1.m"
    assert leader.arbiter.machine.transitions == 0, "a start is no takeover"
    assert leader.tick(5).sent[-1].source == "decentral"


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("ticks", [1, 2, 5])
def test_a_standby_takes_over_with_the_last_of_the_ticks_that_nobody_answers(make_leader, ticks):
    leader = make_leader(standby=True, takeover_ticks=ticks).run(3.0)
    assert (leader.failover.role, leader.sent, leader.failover.asserting) == (Role.STANDBY, [], False)
    leader.tick(ticks - 1)
    assert leader.failover.role is Role.STANDBY
    leader.tick()
    assert leader.failover.role is Role.ACTIVE
    assert f"took over: {ticks} ticks went unanswered" in leader.arbiter.machine.reason


@pytest.mark.requirement("S11")
@pytest.mark.parametrize(
    ("token", "follows"),
    [("999999999.x", True), ("1000000000.x", False), ("5.x.y", True), ("5", False), ("five.x", False)],
)
def test_only_a_term_of_up_to_nine_digits_with_a_name_is_a_claim(leader, token, follows):
    assert leader.failover.on_leader_state(token, leader.stamp_ns) == follows
    assert (leader.failover.role is Role.STANDBY) == follows


@pytest.mark.parametrize("by_command", [True, False])
def test_while_it_listens_a_leader_makes_it_the_standby(make_leader, by_command):
    listener = make_leader()
    listener.measure()
    if by_command:
        listener.failover.on_command("1.other", listener.stamp_ns, "nmpc", Command(80.5, 410.0))
    else:
        assert listener.failover.on_leader_state("1.other", listener.stamp_ns)
    assert listener.failover.role is Role.STANDBY
    assert listener.run(3.0).sent == []


def test_commands_seen_of_its_own_are_nobodys(leader):
    own = leader.sent[-1]
    leader.failover.on_command(leader.failover.token, own.stamp_ns, own.source, own.command)
    assert leader.arbiter.watch.foreign_commands == 0
    leader.failover.on_command("0.other", own.stamp_ns, own.source, own.command)
    assert (leader.arbiter.watch.foreign_commands, leader.events().count("foreign writer")) == (1, 0)
    leader.failover.on_command("", own.stamp_ns, own.source, own.command)
    assert (leader.arbiter.watch.foreign_commands, leader.events().count("foreign writer")) == (2, 1)


def test_the_same_command_of_the_leader_before_does_not_make_the_own_one_foreign(leader):
    """In a takeover both answer a tick, mostly alike; the own command is heard second."""
    own = leader.sent[-1]
    for token in ("0.other", leader.failover.token):
        leader.failover.on_command(token, own.stamp_ns, own.source, own.command)
    assert (leader.arbiter.watch.foreign_commands, leader.events().count("foreign writer")) == (0, 0)
    leader.failover.on_command(leader.failover.token, own.stamp_ns, own.source, own.command)
    assert leader.events().count("foreign writer") == 1, "said twice, it is somebody else's"


@pytest.mark.requirement("S9")
@pytest.mark.parametrize(("age_ticks", "follows"), [(-1, False), (0, True), (10, True), (11, False)])
def test_a_leader_follows_a_command_of_a_newer_term_if_it_answers_a_measurement_of_the_last_second(
    leader, age_ticks, follows
):
    command = Command(81.0, 412.0)
    leader.failover.on_command("7.other", leader.stamp_ns - age_ticks * TICK_NS, "nmpc", command)
    assert (leader.failover.role is Role.STANDBY) == follows
    assert (leader.arbiter.applied == command) == follows
    assert (leader.arbiter.machine.active == "nmpc") == follows


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("age_ticks", [0, 10])
def test_a_standby_takes_over_what_the_leader_has_commanded_lately(make_leader, age_ticks):
    standby = make_leader(standby=True)
    standby.measure()
    standby.failover.on_command("1.other", standby.stamp_ns - age_ticks * TICK_NS, "nmpc", Command(81.0, 412.0))
    assert standby.arbiter.applied == Command(81.0, 412.0)
    standby.failover.on_command("1.other", standby.stamp_ns - 11 * TICK_NS, "nmpc", Command(60.0, 310.0))
    assert standby.arbiter.applied == Command(81.0, 412.0)


@pytest.mark.requirement("S9")
def test_a_command_that_overtakes_its_measurement_counts_as_the_answer(make_leader):
    standby = make_leader(standby=True)
    for _ in range(20):
        stamp_ns = standby.stamp_ns + TICK_NS
        standby.failover.on_command("1.other", stamp_ns, "nmpc", Command(81.0, 412.0))
        standby.tick()
        assert standby.arbiter.ticks.present.stamp_ns == stamp_ns
        assert standby.arbiter.applied == Command(81.0, 412.0)
        assert standby.failover.unanswered == 0
    assert (standby.failover.role, standby.sent) == (Role.STANDBY, [])


def test_a_command_to_a_measurement_that_never_came_answers_no_other(make_leader):
    standby = make_leader(standby=True)
    standby.measure()
    standby.failover.on_command("1.other", standby.stamp_ns, "nmpc", Command(80.0, 410.0))
    standby.run(0.1)
    standby.failover.on_command("1.other", standby.stamp_ns + TICK_NS // 2, "nmpc", Command(60.0, 310.0))
    standby.tick(2)
    assert standby.failover.role is Role.ACTIVE
    assert standby.sent[0].command == Command(80.0, 410.0)


@pytest.mark.requirement("S25")
def test_a_safe_stop_commanded_before_the_first_measurement_is_gone_on_with(make_leader):
    standby = make_leader(standby=True)
    standby.failover.on_command("1.other", standby.stamp_ns + 50 * TICK_NS, "safe_stop", Command(80.0, 410.0))
    standby.tick(5)
    assert {decision.source for decision in standby.sent} == {"safe_stop"}


@pytest.mark.requirement("S9")
@pytest.mark.parametrize(
    ("token", "ahead", "stays"),
    [
        ("0.z", 5, True),
        ("1.a", -1, True),
        ("1.z", -1, True),
        ("1.a", 0, True),
        ("1.z", 0, False),
        ("1.a", 1, False),
        ("2.a", -5, False),
    ],
)
def test_of_two_leaders_that_of_the_greater_term_stays_then_of_the_newer_tick_then_of_the_greater_name(
    leader, token, ahead, stays
):
    follow = leader.failover.on_leader_state(token, leader.stamp_ns + ahead * TICK_NS)
    assert (leader.failover.role is Role.ACTIVE, not follow, leader.failover.asserting) == (stays, stays, stays)
    leader.failover.asserting = False
    assert not leader.failover.asserting


def test_a_leader_that_has_answered_nothing_yet_gives_way_to_one_that_has(make_leader):
    leader = make_leader().run(2 * LISTEN_S)
    assert not leader.failover.on_leader_state("1.a", 0)
    assert leader.failover.on_leader_state("1.a", TICK_NS)


def test_a_new_term_begins_above_each_that_was_heard(make_leader):
    standby = make_leader(standby=True)
    standby.failover.on_leader_state("7.other", standby.stamp_ns)
    standby.failover.on_command("9.other", standby.stamp_ns, "nmpc", Command(80.0, 410.0))
    standby.tick(3)
    assert standby.failover.token == "10.m"


def test_what_it_has_told_itself_is_not_another_leader(leader):
    assert not leader.failover.on_leader_state("9.m", leader.stamp_ns + TICK_NS)
    assert leader.failover.role is Role.ACTIVE


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_standby_is_woken_when_the_leaders_answer_is_overdue(make_leader, lockstep):
    standby = make_leader(standby=True, lockstep=lockstep, takeover_ticks=1)
    assert standby.failover.wakeup_s is None
    standby.measure()
    assert standby.sent == []
    # In lockstep it decides when the controllers had 0.3 s to report, and gives the leader one more second.
    due_s = standby.now_s + (1.3 if lockstep else standby.arbiter.settings.takeover_s(lockstep))
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
    standby.failover.on_command("1.other", standby.stamp_ns, "nmpc", Command(80.0, 410.0))
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
    standby.failover.on_command("1.other", standby.stamp_ns, "nmpc", Command(80.0, 410.0))
    standby.run(0.05)
    assert standby.failover.role is Role.STANDBY, "the answer was in the queue"
    standby.measure()
    standby.sleep(0.5)
    standby.run(0.0)
    standby.run(0.02)
    assert standby.failover.role is Role.STANDBY
    standby.run(0.02)
    assert standby.failover.role is Role.ACTIVE, "there was none"


def test_in_lockstep_a_standby_does_not_wait_out_the_deadlines_for_what_it_has_decided(make_leader):
    """With those of a graph it took over after 60 s, when the plant gave up."""
    patient = {"lockstep_deadline_s": 30.0, "lockstep_shadow_wait_s": 30.0}
    standby = make_leader(standby=True, lockstep=True, **patient)
    standby.measure()
    standby.run(0.9)
    assert standby.failover.role is Role.STANDBY
    standby.run(1.0)
    assert standby.failover.role is Role.ACTIVE
    assert [decision.stamp_ns for decision in standby.sent] == [standby.stamp_ns]


def test_in_lockstep_a_leader_that_answers_in_time_stays(make_leader):
    standby = make_leader(standby=True, lockstep=True, lockstep_deadline_s=30.0)
    for _ in range(5):
        standby.measure()
        standby.run(0.9)
        standby.failover.on_command("1.other", standby.stamp_ns, "nmpc", Command(80.0, 410.0))
    assert standby.failover.role is Role.STANDBY


def test_in_lockstep_the_first_unanswered_tick_is_taken_over(make_leader):
    standby = make_leader(standby=True, lockstep=True)
    standby.measure()
    standby.run(standby.arbiter.settings.takeover_s(True) + 0.01)
    assert standby.failover.role is Role.ACTIVE
    assert [decision.stamp_ns for decision in standby.sent] == [standby.stamp_ns]
    assert standby.arbiter.machine.mode is Mode.AUTO
