"""A plant and controllers as plain calls, for tests of the pure arbiter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest

from fsw_control.contract import Command
from fsw_control.fence import Fence
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.failover import LISTEN_S, Failover
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Machine
from fsw_supervisor.tick import Decision, ProposalInput
from fsw_test_support.ros_graph import domain_id

__all__ = ["domain_id"]

PERIOD_NS = 100_000_000
START = Command(78.4, 407.5)
#: what a kN more adds to the torque at the paper's operating point [N m]
TORQUE_NM_PER_KN = 12.84


def facts(machine: Machine, code: str) -> list[Mapping[str, Any]]:
    """Fields of the events of a code."""
    return [event.fact.data for event in machine.events if event.fact.code == code]


class Rig:
    """Feeds an arbiter tick by tick; a test changes what it wants to go wrong.

    Attributes
    ----------
    names : list of str
        Controllers that propose.
    silent : set of str
        Those that do not.
    delays_s : dict of str to float
        Measurement to proposal, default 5 ms.
    edit : dict of str to callable
        Changes a controller's proposal.
    values : dict of str to float
        What the sensors show; one that is absent does not publish. The torque is that at the
        start's force, and follows the force that acts.
    """

    def __init__(
        self, settings: SupervisorParameters | None = None, lockstep: bool = False
    ) -> None:
        self.arbiter = Arbiter(
            settings if settings is not None else SupervisorParameters.from_values({}),
            lockstep=lockstep,
        )
        self.names = ["decentral", "nmpc"]
        self.silent: set[str] = set()
        self.delays_s: dict[str, float] = {}
        self.edit: dict[str, Callable[[ProposalInput], ProposalInput]] = {}
        self.values = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}
        self.tolerated: dict[str, tuple[str, ...]] = {}
        self.force_wish_kn = START.force_kn
        self.drives: Command | None = START
        self.now_s = 100.0
        self.stamp_ns = 1_000_000_000_000
        self.ticks: list[list[Decision]] = []
        self.seen_source = ""  #: of the last command that the controllers have seen
        self._late: list[tuple[float, str, ProposalInput]] = []

    @property
    def last(self) -> Decision:
        """The last decision."""
        return [decision for tick in self.ticks for decision in tick][-1]

    def proposal(self, name: str) -> ProposalInput:
        """What a healthy controller that follows the applied command would propose."""
        before = self.arbiter.applied or self.drives or START
        force = before.force_kn + min(max(self.force_wish_kn - before.force_kn, -0.5), 0.5)
        return ProposalInput(self.stamp_ns, name, Command(force, before.speed_rpm))

    def tick(self) -> list[Decision]:
        """Run one tick; returns its decisions."""
        arbiter, out = self.arbiter, list[Decision]()
        self.now_s += 0.1
        self.stamp_ns += PERIOD_NS
        before = arbiter.applied
        acting = arbiter.applied or self.drives
        for sensor, value in self.values.items():
            if sensor == "torque" and acting is not None:
                value += TORQUE_NM_PER_KN * (acting.force_kn - START.force_kn)
            out += arbiter.on_sample(sensor, self.stamp_ns, value, self.now_s)
        if self.drives is not None:
            acting = arbiter.applied or self.drives
            out += arbiter.on_drives(self.stamp_ns, acting, self.now_s)
        coming = self._late
        self._late = []
        for name in self.names:
            if name in self.silent:
                continue
            proposal = self.proposal(name)
            if name in self.edit:
                proposal = self.edit[name](proposal)
            coming.append((self.now_s + self.delays_s.get(name, 0.005), name, proposal))
        deadline_s = self.now_s + 0.0999
        for at_s, name, proposal in sorted(coming, key=lambda item: item[0]):
            if at_s > deadline_s:
                self._late.append((at_s, name, proposal))
                continue
            out += self._until(at_s)
            out += arbiter.on_proposal(name, proposal, at_s)
            source = out[-1].source if out else self.seen_source
            out += arbiter.on_status(
                name, self.tolerated.get(name, ()), source == name, at_s, source
            )
        out += self._until(deadline_s)
        for decision in out:
            arbiter.on_command(decision.stamp_ns, decision.source, decision.command)
        if before is not None and out:
            limits = arbiter.settings.drive_limits
            assert abs(out[-1].command.force_kn - before.force_kn) <= limits.force_step_kn + 1e-9
            assert (
                abs(out[-1].command.speed_rpm - before.speed_rpm) <= limits.speed_step_rpm + 1e-9
            )
        self.ticks.append(out)
        self.seen_source = out[-1].source if out else self.seen_source
        return out

    def restart(self) -> Rig:
        """Replace the arbiter by a new one, which knows nothing; controllers and drives go on."""
        self.drives = self.arbiter.applied or self.drives
        self.arbiter = Arbiter(self.arbiter.settings, lockstep=self.arbiter.lockstep)
        return self

    def run(self, count: int) -> Rig:
        """Run some ticks, each of which must give exactly one command."""
        for _ in range(count):
            decisions = self.tick()
            assert len(decisions) == 1
            assert decisions[0].stamp_ns == self.stamp_ns
        return self

    def _until(self, until_s: float) -> list[Decision]:
        out = list[Decision]()
        while (at_s := self.arbiter.wakeup_s) is not None and at_s <= until_s:
            out += self.arbiter.on_time(at_s)
        return out

    def spoil(self, name: str, **changes: object) -> None:
        """Let ``name`` propose with some fields changed."""
        self.edit[name] = lambda proposal: replace(proposal, **changes)  # type: ignore[arg-type]

    def facts(self, code: str) -> list[Mapping[str, Any]]:
        """Fields of the events of a code."""
        return facts(self.arbiter.machine, code)


class Leader:
    """A supervisor alone with plant and controllers.

    Time passes with it running (``run``) or held up (``sleep``).

    Attributes
    ----------
    drives : Command or None
        What the drives report; None: nothing.
    wish : Command
        Where the controllers go, by one move per tick at most.
    measured : int
        Ticks since the start.
    sent : list of Decision
        What it has sent.
    fence : Fence or None
        The actuator end, which hears it alone; None: it does not report.
    """

    def __init__(self, standby: bool = False, lockstep: bool = False, **values: object) -> None:
        self.now_s, self.stamp_ns = 100.0, 10**12
        self.arbiter = Arbiter(SupervisorParameters.from_values(values), lockstep)
        self.failover = Failover(self.arbiter, "m", standby, self.now_s)
        self.drives: Command | None = Command(80.0, 410.0)
        self.wish = Command(80.0, 410.0)
        self.measured = 0
        self.sent: list[Decision] = []
        self.fence: Fence | None = Fence()

    def call(self, decisions: list[Decision]) -> None:
        """Send what the failover lets pass."""
        for decision in self.failover.pass_on(decisions, self.now_s):
            self.sent.append(decision)
            if (
                self.fence is not None
                and self.fence.check(self.failover.signature, decision.source) is None
            ):
                self.fence.take(decision.source, decision.stamp_ns)

    def run(self, seconds: float) -> Leader:
        """Let time pass, and wake it when it wants to be woken."""
        end_s = self.now_s + seconds
        while (at_s := self.failover.wakeup_s) is not None and self.now_s < at_s <= end_s:
            self.now_s = at_s
            self.call(self.arbiter.on_time(at_s))
        self.now_s = end_s
        self.call(self.arbiter.on_time(end_s))
        return self

    def sleep(self, seconds: float) -> None:
        """Let time pass without it."""
        self.now_s += seconds

    def measure(self) -> None:
        """Hand over a measurement and what two controllers propose to it."""
        self.measured += 1
        self.stamp_ns += PERIOD_NS
        if self.fence is not None:
            self.fence.measure()
            self.failover.on_actuator(self.fence.state, self.now_s)
        if self.drives is not None:
            self.call(self.arbiter.on_drives(self.stamp_ns, self.drives, self.now_s))
        for sensor, value in {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}.items():
            self.call(self.arbiter.on_sample(sensor, self.stamp_ns, value, self.now_s))
        for name in ("decentral", "nmpc"):
            before = self.arbiter.applied or self.drives or self.wish
            command = self.arbiter.settings.drive_limits.clip(self.wish, before)
            self.call(
                self.arbiter.on_proposal(
                    name, ProposalInput(self.stamp_ns, name, command), self.now_s
                )
            )
            self.call(self.arbiter.on_status(name, (), False, self.now_s))

    def tick(self, count: int = 1) -> Leader:
        """Run some ticks."""
        for _ in range(count):
            self.measure()
            self.run(0.1)
        return self

    def facts(self, code: str) -> list[Mapping[str, Any]]:
        """Fields of the events of a code."""
        return facts(self.arbiter.machine, code)

    @property
    def ticks_accounted_for(self) -> bool:
        """Whether each tick counts as answered or as lost."""
        arbiter = self.arbiter
        return (
            arbiter.ticks.commands == len(self.sent)
            and arbiter.ticks.commands + arbiter.ticks.lost == self.measured
        )


@pytest.fixture
def make_leader() -> type[Leader]:
    """The class of a supervisor with its failover, which does not lead yet."""
    return Leader


@pytest.fixture
def leader() -> Leader:
    """A leader after ten ticks in control."""
    leader = Leader().run(2 * LISTEN_S).tick(10)
    assert (leader.failover.role, leader.sent[-1].source) == ("active", "decentral")
    return leader


@pytest.fixture
def make_rig() -> type[Rig]:
    """The rig's class."""
    return Rig


@pytest.fixture
def rig() -> Rig:
    """A rig after ten good ticks under the controller ``decentral``."""
    return Rig().run(10)
