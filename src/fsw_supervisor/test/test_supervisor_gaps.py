"""The plant is stopped or started again.

Messages come late, in bursts and in any order across topics.
"""

import itertools

import pytest

from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import ProposalInput

TICK_NS = 100_000_000


class Feed:
    """Single messages into the arbiter of a rig, in the order in which a test says."""

    def __init__(self, rig):
        self.rig, self.arbiter = rig, rig.arbiter
        self.acting = rig.arbiter.applied
        self.now_s, self.stamp_ns = rig.now_s, rig.stamp_ns
        self.out = []

    def drives(self, ahead=0):
        self.out += self.arbiter.on_drives(self.stamp_ns + ahead, self.acting, self.now_s)

    def samples(self, *sensors, ahead=0):
        for sensor in sensors or self.rig.values:
            self.out += self.arbiter.on_sample(
                sensor, self.stamp_ns + ahead, self.rig.values[sensor], self.now_s
            )

    def proposal(self, name, ahead=0, **changes):
        changes = {"command": self.acting} | changes
        proposal = ProposalInput(self.stamp_ns + ahead, name, **changes)
        self.out += self.arbiter.on_proposal(name, proposal, self.now_s)

    def pause(self, seconds):
        end_s = self.now_s + seconds
        while (at_s := self.arbiter.wakeup_s) is not None and at_s <= end_s:
            self.now_s = max(self.now_s, at_s)
            self.out += self.arbiter.on_time(self.now_s)
        self.now_s = end_s
        self.out += self.arbiter.on_time(end_s)

    def next(self, ticks=1):
        self.stamp_ns += ticks * TICK_NS

    def go_on(self, count=10):
        """Good ticks from here on; the source of the last."""
        self.rig.now_s, self.rig.stamp_ns = self.now_s, self.stamp_ns
        for _ in range(count):
            self.out += self.rig.tick()
        return self.out[-1].source


@pytest.fixture(params=["decentral", "nmpc"])
def feed(rig, request):
    """A weld that has run for long under one of two controllers, just before its next tick."""
    rig.tolerated = {
        "decentral": ("torque", "thermocouple"),
        "nmpc": ("depth", "torque", "thermocouple"),
    }
    rig.run(40)
    rig.arbiter.operator.ask_switch(request.param, True, 0.0, "operator", rig.now_s)
    rig.run(40)
    assert rig.last.source == request.param
    feed = Feed(rig)
    feed.active, feed.other = request.param, ({"decentral", "nmpc"} - {request.param}).pop()
    feed.pause(0.1)
    feed.next()
    return feed


def test_stopped_between_the_drives_and_the_sensors(feed):
    """The rest of the tick comes with the next one.

    Who answers it at once is late, who needs longer is not.
    """
    feed.drives()
    feed.pause(1.5)
    assert feed.out[-1].source == "hold"
    feed.samples()
    feed.proposal(feed.active)
    feed.next(15)
    feed.drives()
    feed.samples()
    feed.pause(0.001)
    feed.next()
    feed.drives()
    feed.samples()
    feed.proposal(feed.active)
    feed.proposal(feed.other)
    assert feed.go_on() == feed.active
    assert feed.arbiter.machine.target == feed.active
    assert {decision.source for decision in feed.out} <= {"hold", feed.active}


def test_target_outlasts_a_gap_in_which_a_fallback_is_active(feed):
    """So that the operator sees that another controller commands, and ``return_to_target`` goes back."""
    feed.rig.silent.add(feed.active)
    assert feed.go_on() == feed.other
    feed.rig.silent.clear()
    feed.now_s = feed.rig.now_s
    feed.pause(1.5)
    feed.stamp_ns = feed.rig.stamp_ns
    feed.next(15)
    assert feed.go_on() == feed.other
    assert feed.arbiter.machine.reason == Reason(ReasonCode.ACTIVE_BEFORE, subject=feed.other)
    assert (feed.arbiter.machine.target, feed.arbiter.machine.active) == (feed.active, feed.other)


def test_stopped_between_two_sensors_of_a_tick_that_not_all_have_seen(feed):
    """The sample reached the supervisor and the other controller, not the active one."""
    feed.drives()
    feed.samples("depth")
    feed.proposal(feed.other)
    feed.pause(1.5)
    feed.samples("torque", "thermocouple")
    feed.proposal(feed.active)
    feed.next(15)
    feed.drives()
    feed.samples()
    feed.proposal(feed.active)
    feed.proposal(feed.other)
    assert feed.go_on() == feed.active
    assert {decision.source for decision in feed.out} <= {"hold", feed.active}


def test_two_ticks_in_a_burst_of_which_one_controller_answers_the_first(feed):
    feed.pause(1.5)
    feed.next(14)
    feed.drives()
    feed.samples()
    feed.proposal(feed.other)
    feed.next()
    feed.drives()
    feed.samples()
    feed.proposal(feed.other)
    feed.pause(0.09)
    assert feed.go_on() == feed.active
    assert {decision.source for decision in feed.out} <= {"hold", feed.active}


def test_proposals_overtake_their_measurements(feed):
    feed.pause(1.5)
    feed.next(14)
    for name in (feed.active, feed.other):
        feed.proposal(name)
        feed.proposal(name, ahead=TICK_NS)
    for ahead in (0, TICK_NS):
        feed.drives(ahead=ahead)
        feed.samples(ahead=ahead)
    feed.next()
    assert [decision.source for decision in feed.out] == [feed.active] * 2
    feed.pause(0.1)
    assert feed.go_on() == feed.active


@pytest.mark.parametrize("late", ["depth", "torque", "thermocouple"])
@pytest.mark.parametrize("delay_s", [0.0, 0.1])
def test_a_sensor_is_back_later_than_the_others(feed, late, delay_s):
    """Its last good value is too old to be held, and it takes some samples to be believed again."""
    feed.pause(3.0)
    feed.next(30)
    feed.drives()
    feed.samples(*({"depth", "torque", "thermocouple"} - {late}))
    feed.pause(0.012)
    feed.proposal(feed.other)
    feed.proposal(feed.active)
    feed.pause(delay_s)
    if delay_s < 0.08:
        feed.samples(late)
        feed.pause(0.08)
    assert feed.go_on() == feed.active
    assert {decision.source for decision in feed.out} <= {"hold", feed.active}


@pytest.mark.parametrize(
    "changes", [{"healthy": False, "reason": Reason.of("waiting")}, {"command": None}]
)
def test_the_first_proposal_after_the_gap_cannot_be_applied(feed, changes):
    """The plant restarts elsewhere, or the controller lacks a sensor."""
    feed.pause(3.0)
    feed.next(30)
    believed, feed.acting = feed.acting, Command(feed.acting.force_kn, feed.acting.speed_rpm - 5.0)
    if "command" in changes:
        changes = {"command": believed}
    feed.drives()
    feed.samples()
    feed.proposal(feed.other)
    feed.proposal(feed.active, **changes)
    feed.pause(0.1)
    feed.rig.drives = feed.acting
    assert feed.go_on() == feed.active
    assert {decision.source for decision in feed.out} <= {"hold", feed.active}


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))))
def test_a_second_gap_before_the_first_is_over(feed, order):
    for _ in range(2):
        feed.pause(1.5)
        feed.next(15)
        feed.drives()
        feed.samples()
    calls = [
        feed.drives,
        lambda: feed.samples("depth"),
        lambda: feed.proposal(feed.other),
        lambda: feed.pause(0.02),
    ]
    for number in order:
        calls[number]()
    feed.pause(0.09)
    assert feed.go_on() == feed.active


def test_who_was_active_and_does_not_come_back_is_replaced(feed):
    feed.rig.silent.add(feed.active)
    feed.pause(1.5)
    feed.next(15)
    assert feed.go_on(20) == feed.other
    assert feed.rig.facts("mode")[-1]["reason"] == Reason(
        ReasonCode.ABANDONED, subject=feed.active
    )


def test_a_controller_that_dies_is_replaced_in_the_same_tick_and_with_a_sensor_lost_in_the_next(
    rig,
):
    rig.run(40)
    rig.silent.add("decentral")
    del rig.values["torque"]
    rig.tolerated = dict.fromkeys(rig.names, ("torque",))
    rig.run(2)
    assert [tick[-1].source for tick in rig.ticks[-2:]] == ["hold", "nmpc"]
    assert rig.ticks[-2][-1].reason == Reason(ReasonCode.INCOMPLETE, ("torque",))


@pytest.mark.parametrize("push", [Command(4.0, 0.0), Command(-4.0, 9.0), Command(0.4, -1.0)])
@pytest.mark.parametrize("ramped_kn", [0.0, 3.0])
def test_external_load_is_not_taken_for_a_command(feed, push, ramped_kn):
    """The drives report an input disturbance, before the gap and after it.

    The plant may have lowered the force.
    """
    commanded = feed.acting
    pushed = Command(commanded.force_kn + push.force_kn, commanded.speed_rpm + push.speed_rpm)
    for _ in range(5):
        feed.acting = pushed
        feed.drives()
        feed.acting = commanded
        feed.samples()
        feed.proposal(feed.active)
        feed.proposal(feed.other)
        feed.pause(0.1)
        feed.next()
    feed.pause(2.0)
    feed.next(20)
    feed.acting = Command(pushed.force_kn - ramped_kn, pushed.speed_rpm)
    feed.drives()
    feed.samples()
    feed.proposal(feed.active, command=commanded)
    feed.pause(0.09)
    first = feed.out[-1].command
    assert abs(first.force_kn - (commanded.force_kn - ramped_kn)) <= 1.0
    assert abs(first.speed_rpm - commanded.speed_rpm) <= 3.0
    assert feed.arbiter.machine.mode in (Mode.AUTO, Mode.START)


@pytest.mark.parametrize("push", [Command(4.0, 0.0), Command(0.0, -9.0), Command(12.0, 9.0)])
def test_a_restart_while_something_pushes_is_no_bump(make_rig, push):
    """A new supervisor knows no offset: who was active tells what was commanded."""
    rig, commanded = make_rig(), Command(80.0, 410.0)
    feed = Feed(rig)
    feed.acting = Command(commanded.force_kn + push.force_kn, commanded.speed_rpm + push.speed_rpm)
    for name in rig.names:
        feed.arbiter.registry.join(name)
    for _ in range(8):
        feed.next()
        feed.drives()
        feed.samples()
        for name in rig.names:
            feed.proposal(name, command=commanded)
            feed.arbiter.on_status(name, (), name == "nmpc", feed.now_s)
        feed.pause(0.1)
    assert {decision.source for decision in feed.out} == {"nmpc"}
    assert {decision.command for decision in feed.out} == {commanded}


def test_holding_at_the_start_does_not_chase_the_drives(make_rig):
    rig = make_rig()
    feed = Feed(rig)
    acting = Command(80.0, 410.0)
    for _ in range(40):
        feed.next()
        feed.acting = Command(acting.force_kn + 4.0, acting.speed_rpm)
        feed.drives()
        feed.samples()
        feed.pause(0.1)
        acting = feed.out[-1].command if feed.out else acting
    assert feed.out and {decision.command for decision in feed.out} == {Command(84.0, 410.0)}


@pytest.mark.requirement("S9")
def test_after_a_stall_measurements_that_are_missing_count_as_a_gap(leader):
    """Its queues have kept the first measurements only.

    What is in force is read from the drives.
    """
    leader.sleep(2.0)
    leader.measure()
    leader.stamp_ns += 2_000_000_000
    leader.drives = None
    before = len(leader.sent)
    leader.tick()
    assert len(leader.sent) == before, "what is in force is not known"
    leader.drives = Command(70.0, 410.0)
    leader.tick(2)
    assert abs(leader.sent[-1].command.force_kn - 70.0) <= 2.0
