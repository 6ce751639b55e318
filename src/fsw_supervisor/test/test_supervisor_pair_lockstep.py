"""Two supervisors in lockstep: simulated time stands while a process is late, and nobody is dead for that."""

from __future__ import annotations

import heapq
import itertools

import hypothesis.strategies as st
import pytest
from hypothesis import settings as hypothesis_settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from fsw_control.contract import Command
from fsw_control.fence import Fence
from fsw_control.light_node_ros import DELIVERY_S
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.tick import ProposalInput

#: a leader publishes its state so often, and its node looks at the time [s]
STATE_S, LOOK_S = 1.0, 0.2
#: the plant repeats an unanswered tick, and lets a tick begin after an answer [s]
REPEAT_S, STEP_S = 2.0, 0.5
FLIGHT_S = 0.001
#: after this time a supervisor that lives leads, even after some takeovers just before [s]
PATIENT_S = 40.0
SETTINGS = SupervisorParameters.from_values(
    {"lockstep_deadline_s": 5.0, "lockstep_shadow_wait_s": 5.0}
)
HOME = Command(78.4, 407.5)
VALUES = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}


class Member:
    """A supervisor process; what arrives while it is stopped, or held up in a call, waits."""

    def __init__(self, world, identity, standby):
        self.world, self.identity = world, identity
        self.arbiter = Arbiter(SETTINGS, lockstep=True)
        self.failover = Failover(self.arbiter, identity, standby, world.now_s)
        self.queue, self.stopped, self.busy_until_s = [], False, 0.0
        self.deaf_to = set()  #: controllers whose proposals do not arrive here
        self.is_heard = True  #: its commands arrive at the other supervisor
        self.published, self.report_s = None, 0.0

    @property
    def runs(self):
        return not self.stopped and self.world.now_s >= self.busy_until_s

    def hear(self, call):
        self.queue.append(call)
        self.work()

    def work(self):
        while self.queue and self.runs:
            self.publish(self.queue.pop(0)(self) or [])

    def look(self):
        self.hear(lambda member: member.arbiter.on_time(self.world.now_s))

    def publish(self, decisions):
        world = self.world
        for decision in self.failover.pass_on(decisions, world.now_s):
            sent = (self.failover.signature, decision.stamp_ns, decision.source, decision.command)
            world.later(FLIGHT_S, world.obey, *sent)
            if self.is_heard:
                world.broadcast(self, lambda member, sent=sent: member.failover.on_command(*sent))
        seen = (self.failover.role, self.arbiter.machine.revision)
        if seen != self.published or world.now_s >= self.report_s:
            self.published, self.report_s = seen, world.now_s + STATE_S
            if self.failover.role is Role.ACTIVE:
                signature = self.failover.signature
                world.broadcast(
                    self, lambda member: member.failover.on_leader_state(signature) and None
                )


class World:
    """Plant in lockstep, two controllers, supervisors, on a clock of the world's own."""

    def __init__(self):
        self.now_s, self.stamp_ns = 100.0, 0
        self.events, self.serial = [], itertools.count()
        self.fence, self.acting, self.source = Fence(), HOME, ""
        self.answered, self.awake_s = True, 0.0
        self.slow_s = dict.fromkeys(("decentral", "nmpc"), FLIGHT_S)
        self.terms = []  #: term and leader of each command that acts
        self.members = [Member(self, "a", False)]
        self.look()
        self.run(0.5)
        self.members.append(Member(self, "b", True))
        self.measure()
        self.run(4.0)

    def later(self, delay_s, call, *args):
        heapq.heappush(self.events, (self.now_s + delay_s, next(self.serial), call, args))

    def broadcast(self, sender, call):
        for member in self.members:
            if member is not sender:
                self.later(FLIGHT_S, member.hear, call)

    def run(self, seconds):
        end_s = self.now_s + seconds
        while self.events and self.events[0][0] <= end_s:
            due_s, _, call, args = heapq.heappop(self.events)
            self.now_s = max(self.now_s, due_s)
            call(*args)
            for member in self.members:
                member.work()
        self.now_s = end_s

    def look(self):
        for member in self.members:
            member.look()
        self.later(LOOK_S, self.look)

    # ---- the plant

    def measure(self):
        self.stamp_ns += 100_000_000
        self.answered = False
        self.fence.measure()
        self.send(self.stamp_ns)

    def send(self, stamp_ns):
        if stamp_ns != self.stamp_ns or self.answered:
            return
        state, acting = self.fence.state, self.acting

        def report(member):
            member.failover.on_actuator(state, self.now_s)
            return member.arbiter.on_drives(stamp_ns, acting, self.now_s)

        self.broadcast(None, report)
        for item in VALUES.items():
            self.broadcast(
                None,
                lambda member, item=item: member.arbiter.on_sample(
                    item[0], stamp_ns, item[1], self.now_s
                ),
            )
        for name, delay_s in self.slow_s.items():
            self.later(delay_s, self.propose, name, stamp_ns, acting)
        self.later(REPEAT_S, self.send, stamp_ns)

    def propose(self, name, stamp_ns, acting):
        proposal, source = ProposalInput(stamp_ns, name, acting), self.source

        def take(member):
            out = member.arbiter.on_proposal(name, proposal, self.now_s)
            return out + member.arbiter.on_status(name, (), source == name, self.now_s, source)

        for member in self.members:
            if name not in member.deaf_to:
                self.later(FLIGHT_S, member.hear, take)

    def obey(self, signature, stamp_ns, source, command):
        if self.fence.check(signature, source) is not None:
            return
        if stamp_ns == self.stamp_ns and not self.answered:
            self.answered, self.acting, self.source = True, command, source
            self.fence.take(source, stamp_ns)
            self.terms.append((signature.term, signature.leader))
            self.later(max(STEP_S, self.awake_s - self.now_s), self.measure)

    @property
    def leaders(self):
        return [member for member in self.members if member.failover.role is Role.ACTIVE]


class Lockstep(RuleBasedStateMachine):
    """What may happen while both supervisors live."""

    def __init__(self):
        super().__init__()
        self.world = World()
        assert [member.identity for member in self.world.leaders] == ["a"]
        assert self.world.terms[-1] == (1, "a") and self.world.source == "decentral"

    @rule(seconds=st.floats(0.001, 8.0))
    def run(self, seconds):
        self.world.run(seconds)

    @rule(
        name=st.sampled_from(["decentral", "nmpc"]),
        delay_s=st.sampled_from([FLIGHT_S, 0.7, 1.5, 4.0]),
    )
    def slow_controller(self, name, delay_s):
        self.world.slow_s[name] = delay_s

    @rule(which=st.integers(0, 1))
    def recorder_stalls(self, which):
        """A supervisor waits for a recorder that does not receive: once, then not again for some time."""
        member = self.world.members[which]
        member.busy_until_s = self.world.now_s + DELIVERY_S
        self.world.later(DELIVERY_S, member.work)
        self.world.run(STATE_S + DELIVERY_S)

    @rule(seconds=st.floats(0.1, 2.0))
    def plant_waits(self, seconds):
        self.world.awake_s = self.world.now_s + seconds

    @rule(which=st.integers(0, 1), name=st.sampled_from(["decentral", "nmpc"]))
    def proposals_are_lost(self, which, name):
        self.world.members[which].deaf_to ^= {name}

    @rule()
    def commands_are_not_heard_by_the_standby(self):
        self.world.members[0].is_heard ^= True


class BothLive(Lockstep):
    """A leader that lives keeps its term, whatever other processes do."""

    @invariant()
    def leader_stays(self):
        assert set(self.world.terms) == {(1, "a")}
        assert [member.identity for member in self.world.leaders] == ["a"]


class OneStops(Lockstep):
    """A supervisor may be suspended, too, for any time."""

    @rule(which=st.integers(0, 1))
    def stop(self, which):
        self.world.members[which].stopped = True

    @rule(which=st.integers(0, 1))
    def go_on(self, which):
        self.world.members[which].stopped = False
        self.world.members[which].work()

    @invariant()
    def terms_never_fall(self):
        terms = self.world.terms
        assert terms == sorted(terms)
        assert len(dict(terms)) == len(set(terms)), "a term has one leader"

    @invariant()
    def time_continues_under_one_leader(self):
        """As long as one runs; the one that continues last gives way."""
        if all(member.stopped for member in self.world.members):
            return
        world, count, end_s = self.world, len(self.world.terms), self.world.now_s + PATIENT_S
        while True:
            leaders = [not member.stopped for member in world.leaders]
            if len(world.terms) > count and leaders.count(True) == 1:
                return
            assert world.now_s < end_s
            world.run(0.5)


for machine in (BothLive, OneStops):
    machine.TestCase.settings = hypothesis_settings(
        max_examples=15, stateful_step_count=10, deadline=None
    )
TestBothLive = pytest.mark.requirement("S9")(BothLive.TestCase)
TestOneStops = pytest.mark.requirement("S9")(OneStops.TestCase)
