"""Two supervisors, one of which leads: each may stop and go on at any moment."""

from __future__ import annotations

import heapq
import itertools

import hypothesis.strategies as st
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.fence import Fence, Signature
from fsw_control.reason import Reason
from fsw_control.sensors import REQUIRED
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import ProposalInput

VALUES = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}
#: what a kN more adds to the torque at the paper's operating point [N m]
TORQUE_NM_PER_KN = 12.84
PERIOD_NS = 100_000_000


class Member:
    """One supervisor process; what comes while it is stopped waits."""

    def __init__(self, world, identity, standby, settings):
        self.world, self.identity = world, identity
        self.arbiter = Arbiter(settings)
        self.failover = Failover(self.arbiter, identity, standby, world.now_s)
        self.running, self.queue, self.told, self.tell_s = True, [], None, 0.0
        self.lag_s = 0.001  # until it hears another supervisor

    def hear(self, call):
        if self.running:
            self.run(call)
        else:
            self.queue.append(call)

    def run(self, call):
        self.publish(call(self) or [])

    def publish(self, decisions):
        for decision in self.failover.pass_on(decisions, self.world.now_s):
            self.world.command(self.failover.signature, decision)
        seen = (self.failover.role, self.arbiter.machine.revision)
        if seen != self.told or self.failover.asserting or self.world.now_s >= self.tell_s:
            self.told, self.tell_s = seen, self.world.now_s + 1.0
            self.failover.asserting = False
            self.world.tell(self)

    def go_on(self):
        self.running = True
        queue, self.queue = self.queue, []
        for call in queue:
            self.run(call)


class World:
    """Plant with its fence, controllers and wires.

    Obeys the first command of each stamp, as the plant does.
    """

    def __init__(self, settings=None):
        self.settings = settings if settings is not None else SupervisorParameters.from_values({})
        self.now_s = 100.0
        self.stamp_ns = 10**12
        self.acting = Command(78.4, 407.5)
        self.source = ""
        self.wish_kn = 78.4
        self.names = ["decentral", "nmpc"]
        self.members = []
        self.events, self.order = [], itertools.count()
        self.accepted = {}
        self.refused = 0
        self.stamps = []
        self.fence = Fence()
        self.taken = []  # terms of the commands taken, in turn

    def add(self, identity, standby=False):
        self.members.append(Member(self, identity, standby, self.settings))
        return self.members[-1]

    def later(self, delay_s, call):
        for member in self.members:
            due_s = self.now_s + (member.lag_s if delay_s is None else delay_s)
            heapq.heappush(self.events, (due_s, next(self.order), member, call))

    def command(self, signature, decision):
        sent = (signature, decision.stamp_ns, decision.source, decision.command)
        passes = self.fence.check(signature, decision.source) is None
        if passes and decision.stamp_ns > max(self.accepted, default=0):
            assert abs(decision.command.force_kn - self.acting.force_kn) <= 1.0 + 1e-9
            self.accepted[decision.stamp_ns] = decision.source
            self.acting, self.source = decision.command, decision.source
            self.fence.take(decision.source, decision.stamp_ns)
            self.taken.append(signature.term)
        else:
            self.refused += 1
        self.later(None, lambda member: member.failover.on_command(*sent))

    def tell(self, teller):
        signature, target = teller.failover.signature, teller.arbiter.machine.target
        mode, standing = str(teller.arbiter.machine.target_mode), teller.arbiter.machine.standing
        self.fence.register.merge(signature.stop)

        def claim(member):
            if teller.failover.role is Role.ACTIVE and member.failover.on_leader_state(signature):
                member.arbiter.follow_operator(target, mode, {}, standing)
            elif member is not teller:
                member.failover.on_stop(signature.stop)

        self.later(None, claim)

    def tick(self, count=1):
        for _ in range(count):
            self._tick()
        return self

    def _tick(self):
        self.stamp_ns += PERIOD_NS
        stamp, acting = self.stamp_ns, self.acting
        self.stamps.append(stamp)
        self.fence.measure()
        state = self.fence.state

        def report(member):
            member.failover.on_actuator(state, self.now_s)
            return member.arbiter.on_drives(stamp, acting, self.now_s)

        self.later(0.0, report)
        for sensor in REQUIRED:
            value = VALUES[sensor]
            if sensor == "torque":
                value += TORQUE_NM_PER_KN * (self.acting.force_kn - 78.4)
            self.later(
                0.0,
                lambda member, s=sensor, v=value: member.arbiter.on_sample(
                    s, stamp, v, self.now_s
                ),
            )
        force = acting.force_kn + min(max(self.wish_kn - acting.force_kn, -0.7), 0.7)
        for name in self.names:
            proposal = ProposalInput(stamp, name, Command(force, acting.speed_rpm))
            self.later(
                0.005,
                lambda member, n=name, p=proposal: member.arbiter.on_proposal(n, p, self.now_s),
            )
            source = self.source
            self.later(
                0.006,
                lambda member, n=name, s=source: member.arbiter.on_status(
                    n, (), s == n, self.now_s, s
                ),
            )
        start_s = self.now_s
        for step in range(100):
            self.now_s = start_s + step * 1e-3
            self._wires()
            for member in self.members:
                wakeup_s = member.failover.wakeup_s
                if member.running and (
                    step % 50 == 49 or (wakeup_s is not None and wakeup_s <= self.now_s)
                ):
                    member.hear(lambda member: member.arbiter.on_time(self.now_s))
        self.now_s = start_s + 0.1

    def wait(self, seconds):
        """Let time pass without measurements."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s += 0.05
            self._wires()
            for member in self.members:
                member.hear(lambda member: member.arbiter.on_time(self.now_s))

    def _wires(self):
        while self.events and self.events[0][0] <= self.now_s + 1e-9:
            _, _, member, call = heapq.heappop(self.events)
            if member in self.members:
                member.hear(call)

    @property
    def active(self):
        return [member.identity for member in self.members if member.failover.role is Role.ACTIVE]

    def lost(self, last):
        return sum(stamp not in self.accepted for stamp in self.stamps[-last:])


@pytest.fixture
def world():
    """A weld under ``a`` with the standby ``b``."""
    world = World()
    world.add("a")
    world.tick(5)
    world.add("b", standby=True)
    world.tick(15)
    assert (world.active, world.lost(10), world.source) == (["a"], 0, "decentral")
    return world


@pytest.mark.requirement("S9")
def test_the_standby_takes_over_after_two_ticks_and_loses_one(world):
    a, b = world.members
    world.members.remove(a)
    world.tick(20)
    assert world.active == ["b"]
    assert world.lost(20) == 1
    assert world.source == "decentral"
    assert b.arbiter.machine.cause is Cause.READY, "a takeover changes who leads, not why"


def test_it_takes_over_what_the_operator_chose(world):
    a, b = world.members
    a.arbiter.operator.ask_switch("nmpc", False, 1.0, "operator", world.now_s)
    world.tick(5)
    assert world.source == "nmpc"
    world.members.remove(a)
    world.tick(10)
    assert world.source == "nmpc"
    assert b.arbiter.machine.target == "nmpc"


@pytest.mark.parametrize("mode", [Mode.MANUAL, Mode.HOLD, Mode.SAFE_STOP])
def test_it_stays_in_the_mode_that_the_operator_chose(world, mode):
    a, b = world.members
    a.arbiter.operator.ask_mode(str(mode), Command(78.0, 407.0), "operator")
    world.tick(5)
    world.members.remove(a)
    world.tick(10)
    assert world.source == mode
    assert (b.arbiter.machine.mode, b.arbiter.machine.target_mode) == (mode, mode)


@pytest.mark.requirement("S9", "S25")
def test_a_takeover_leaves_no_safe_stop_by_a_request_before_it(world):
    a, b = world.members
    a.arbiter.operator.ask_mode("manual", Command(78.0, 407.0), "operator")
    world.tick(5)
    a.arbiter.machine.fire(Cause.INTERLOCK_TRIP, Reason(), "interlock")
    world.tick(30)
    assert a.arbiter.operator.acknowledge("operator")[0]
    world.tick(5)
    assert b.arbiter.machine.acknowledged and b.arbiter.machine.target_mode is Mode.MANUAL
    world.members.remove(a)
    world.tick(10)
    assert world.source == Mode.SAFE_STOP and b.arbiter.machine.mode is Mode.SAFE_STOP


@pytest.mark.requirement("S9", "S25")
@pytest.mark.parametrize(
    ("mode", "cause"),
    [
        (Mode.MANUAL, Cause.OPERATOR_MANUAL),
        (Mode.HOLD, Cause.OPERATOR_HOLD),
        (Mode.SAFE_STOP, Cause.STOP_HEARD),
    ],
)
def test_mode_that_was_accepted_by_a_leader_that_dies_before_its_next_command_is_not_lost(
    world, mode, cause
):
    a, b = world.members

    def ask(member):
        assert member.arbiter.operator.ask_mode(str(mode), Command(78.0, 407.0), "anna")[0]

    a.hear(ask)
    world.now_s += 0.01
    world._wires()  # what it tells of itself
    world.members.remove(a)
    world.tick(10)
    assert world.source == mode
    machine = b.arbiter.machine
    assert (machine.mode, machine.cause) == (mode, cause)
    assert machine.who == ("anna" if cause is Cause.STOP_HEARD else "operator")


@pytest.mark.requirement("S25")
def test_an_acknowledgement_outlasts_a_failover_and_the_safe_stop_is_left_on_request(world):
    a, b = world.members
    a.arbiter.operator.ask_mode("safe_stop", None, "operator")
    world.tick(3)
    assert not b.arbiter.operator.ask_mode("auto", None, "operator")[0]
    assert a.arbiter.operator.acknowledge("operator")[0]
    world.tick(3)
    a.running = False
    world.tick(5)
    assert (b.failover.role, world.source) == (Role.ACTIVE, "safe_stop"), (
        "an acknowledgement alone changes nothing"
    )
    assert b.arbiter.operator.ask_mode("auto", None, "operator")[0]
    world.tick(2)
    assert world.source == "decentral"


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("lag_s", [0.15, 0.4, 2.0])
def test_supervisors_that_hear_each_other_late_do_not_take_over(world, lag_s):
    a, b = world.members
    a.lag_s = b.lag_s = lag_s
    world.tick(30)
    assert (world.active, world.lost(30)) == (["a"], 0)
    assert b.failover.role is Role.STANDBY


@pytest.mark.requirement("S25")
def test_a_safe_stop_that_has_been_acknowledged_does_not_come_back_with_the_leader_before(world):
    a, b = world.members
    a.arbiter.operator.ask_mode("safe_stop", None, "operator")
    world.tick(3)
    a.running = False
    world.tick(5)
    assert (
        b.arbiter.operator.acknowledge("operator")[0]
        and b.arbiter.operator.ask_mode("auto", None, "operator")[0]
    )
    world.tick(3)
    a.lag_s = 0.4  # it hears late that it no longer leads, and tells of its safe stop before
    a.queue.clear()
    a.go_on()
    world.tick(3)
    a.lag_s = 0.001
    world.tick(12)
    assert (world.active, world.source) == (["b"], "decentral")


@pytest.mark.parametrize("ticks", [1, 2, 3, 5, 9, 30])
def test_the_one_that_was_stopped_becomes_the_standby(world, ticks):
    a, _ = world.members
    world.wish_kn = 90.0
    a.running = False
    world.tick(ticks)
    a.go_on()
    world.tick(20)
    assert len(world.active) == 1
    assert world.active == (["a"] if ticks == 1 else ["b"])
    assert world.lost(ticks + 20) <= 1
    assert world.source == "decentral"


@pytest.mark.parametrize("lag_s", [0.03, 0.09, 0.19, 0.6])
@pytest.mark.parametrize("ticks", [2, 3, 9])
@pytest.mark.parametrize("names", ["ab", "ba"])
def test_the_one_that_was_stopped_never_wins_however_late_it_hears_of_the_other(
    names, ticks, lag_s
):
    world = World()
    a = world.add(names[0])
    world.tick(5)
    b = world.add(names[1], standby=True)
    world.tick(15)
    a.running, a.lag_s = False, lag_s
    world.tick(ticks)
    assert b.failover.role is Role.ACTIVE
    a.go_on()
    for _ in range(20):
        world.tick()
        assert b.failover.role is Role.ACTIVE
        if a.failover.role is Role.STANDBY:
            a.lag_s = 0.001
    assert a.failover.role is Role.STANDBY
    assert world.taken == sorted(world.taken), "terms never fall"


def test_leader_reported_by_the_plant_stays():
    world = World()
    a, b = world.add("a"), world.add("b")
    a.lag_s = b.lag_s = 60.0
    world.tick(15)
    assert len(world.active) == 1
    assert world.lost(5) == 0


def test_the_standby_takes_over_with_a_controller_that_has_failed_at_the_same_time(world):
    world.members.pop(0)
    world.names = ["nmpc"]
    world.tick(10)
    assert world.source == "nmpc"
    assert world.lost(10) <= 2


def test_a_stopped_standby_does_no_harm(world):
    _, b = world.members
    b.running = False
    world.tick(30)
    b.go_on()
    world.tick(20)
    assert (world.active, world.lost(50), world.refused) == (["a"], 0, 0)


def test_a_restarted_one_becomes_the_standby(world):
    world.members.pop(0)
    world.tick(10)
    world.add("c")
    world.tick(10)
    assert world.active == ["b"]
    world.members.pop(0)
    world.tick(10)
    assert world.active == ["c"]
    assert world.lost(20) <= 1


def test_two_that_start_together_become_one_active_and_one_standby():
    world = World()
    world.add("a")
    world.add("b")
    world.tick(20)
    assert len(world.active) == 1
    assert world.lost(10) == 0
    assert world.taken == sorted(world.taken)


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("lag_s", [0.001, 0.3, 3.0])
@pytest.mark.parametrize("late_s", [0.0, 0.2, 4.9])
def test_one_of_two_standbys_leads_before_the_first_measurement(lag_s, late_s):
    world = World()
    a = world.add("a", standby=True)
    world.wait(late_s)
    b = world.add("b", standby=True)
    a.lag_s = b.lag_s = lag_s
    world.wait(15.0)
    assert len(world.active) == 1
    world.tick(10)
    assert len(world.active) == 1
    assert (world.source, len(set(world.taken))) == ("decentral", 1)


def test_a_standby_alone_begins_by_itself():
    world = World()
    world.add("b", standby=True)
    world.tick(20)
    assert world.active == ["b"]
    assert world.source == "decentral"


def test_without_measurements_nobody_takes_over(world):
    b = world.members[1]
    world.members[0].running = False
    for _ in range(50):
        world.now_s += 0.1
        b.hear(lambda member: member.arbiter.on_time(world.now_s))
    assert b.failover.role is Role.STANDBY


def test_wild_commands_do_not_move_the_standby(world):
    b = world.members[1]
    before, leader = b.arbiter.applied, Signature(1, "a")
    b.failover.on_command(leader, world.stamp_ns, "x", Command(float("nan"), 400.0))
    b.failover.on_command(leader, world.stamp_ns - 10**12, "x", Command(61.0, 310.0))
    b.failover.on_command(Signature(), world.stamp_ns, "x", Command(61.0, 310.0))
    assert b.arbiter.applied == before


def test_a_wild_command_of_a_later_term_does_not_move_the_leader(world):
    a = world.members[0]
    before = a.arbiter.applied
    a.failover.on_command(
        Signature(9, "z"), world.stamp_ns, "decentral", Command(float("nan"), 400.0)
    )
    assert (a.arbiter.applied, a.failover.role) == (before, Role.ACTIVE)
    world.tick(5)
    assert (world.active, world.lost(5)) == (["a"], 0)


def test_a_command_without_a_measurement_keeps_nobody_from_leading():
    world = World()
    a = world.add("a")
    a.failover.on_command(Signature(1, "b"), world.stamp_ns, "x", Command(61.0, 310.0))
    world.tick(3)
    assert a.failover.role is Role.ACTIVE


steps = st.lists(
    st.tuples(
        st.sampled_from(["run", "stop a", "stop b", "go a", "go b", "kill a", "kill b"]),
        st.integers(1, 12),
        st.floats(70.0, 90.0),
    ),
    max_size=12,
)


@pytest.mark.requirement("S9")
@pytest.mark.slow
@given(steps=steps, takeover_ticks=st.integers(1, 3))
@hypothesis_settings(deadline=None)
def test_whatever_stops_and_goes_on_one_leads_in_the_end_without_a_bump(steps, takeover_ticks):
    world = World(SupervisorParameters.from_values({"takeover_ticks": takeover_ticks}))
    world.add("a")
    world.tick(3)
    world.add("b", standby=True)
    world.tick(10)
    serial = itertools.count()
    for action, ticks, wish_kn in steps:
        verb, _, which = action.partition(" ")
        world.wish_kn = wish_kn
        member = world.members[which == "b"]
        if verb == "stop":
            member.running = False
        elif verb == "go" and not member.running:
            member.go_on()
        elif verb == "kill":
            world.members.remove(member)
            world.members.insert(
                which == "b", fresh := Member(world, f"n{next(serial)}", False, world.settings)
            )
            assert fresh.failover.role is Role.LISTENING
        world.tick(ticks)
    for member in world.members:
        if not member.running:
            member.go_on()
    world.tick(25)
    assert len(world.active) == 1
    assert world.lost(10) == 0
    assert world.taken == sorted(world.taken)


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("standby_first", [True, False])
def test_leader_and_standby_die_together_in_a_safe_stop_and_it_goes_on(world, standby_first):
    a, _ = world.members
    a.arbiter.operator.ask_mode("safe_stop", None, "operator")
    world.tick(5)
    assert world.source == "safe_stop"
    world.members.clear()
    world.tick(8)
    world.add("c", standby=standby_first)
    world.add("d", standby=not standby_first)
    for _ in range(20):
        world.tick()
        assert world.source == "safe_stop"
    assert len(world.active) == 1
    assert world.lost(5) == 0
    leader = next(member for member in world.members if member.identity in world.active)
    assert leader.arbiter.machine.mode is Mode.SAFE_STOP
    assert not leader.arbiter.machine.acknowledged
