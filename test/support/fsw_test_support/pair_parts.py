"""The parts of a pair's world: supervisors, controllers and page, each as its node uses its core.

The actuator end is in ``pair_ends.py``.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from fsw_control.applied import AppliedCommand, AppliedCommands
from fsw_control.command_gate import refusal
from fsw_control.contract import Command
from fsw_control.fence import ActuatorState, Signature
from fsw_control.sensors import REQUIRED
from fsw_control.stop import Stop, StopCause, StopRegister
from fsw_control.units import NANOSECONDS
from fsw_control.weld import TICK_S
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.confirmation import Confirmation, Confirmations
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.state_machine import Mode, Standing
from fsw_supervisor.tick import Decision, ProposalInput
from fsw_test_support.pair_rules import SWITCH_S, Request
from fsw_test_support.pair_settings import HOME, NAMES, SETTINGS
from fsw_test_support.supervisor_pair import SUPERVISORS, Process, World

_HOUSEKEEPING_S, _REPEAT_S, _REPORT_S = 0.2, 1.0, 1.0
#: computing time of the controllers
_COMPUTE_S = 0.004
HOLDERS = (*SUPERVISORS, "end", "page")


class Holder(Process):
    """A process with a copy of the stop register.

    Publishes it at every change and once a second, as ``StopHolder``.
    """

    register: StopRegister
    _published: Stop | None = None

    def look(self) -> None:
        """Publish the copy if it has changed."""
        if self._published is not self.register.value:
            self._publish_stop()

    def _publish_stop(self) -> None:
        value = self._published = self.register.value
        if value.epoch:
            self.world.broadcast(self.name, HOLDERS, "on_stop", value)

    def repeat(self) -> None:
        """A second has passed."""
        self._publish_stop()
        self.world.at(self.world.now_s + _REPEAT_S, self, "repeat", is_timer=True)

    def greet(self, name: str) -> None:
        """Hand the latched report to a process that has begun."""
        if name in HOLDERS and self.register.value.epoch:
            self.world.send(self.name, name, "on_stop", self.register.value)

    def on_stop(self, stop: Stop) -> None:
        """Take another part's copy."""
        self.register.merge(stop)
        self.look()


class Supervisor(Holder):
    """A supervisor as ``supervisor_node.py`` and ``services_ros.py`` run its cores."""

    def __init__(self, name: str, world: World, standby: bool = False) -> None:
        super().__init__(name, world)
        self._standby = standby
        self.writes = False  #: it has a publisher of commands

    def begin(self) -> None:
        """Begin as a fresh process with an identity of its own."""
        now_s = self.world.now_s
        self.arbiter = Arbiter(SETTINGS)
        self.identity = f"{self.name}{self.life}"
        self.failover = Failover(self.arbiter, self.identity, self._standby, now_s)
        self.register = self.arbiter.machine.register
        self.confirmations = Confirmations(self.failover, 0.0)
        self.requests: list[Request] = []
        self._uncertain: list[Request] = []
        self._published, self._reported, self._report_s = None, (-1, Role.LISTENING), 0.0
        self._armed_s: float | None = None
        for name in NAMES:
            self.arbiter.registry.join(name)
        self.housekeep()
        self.repeat()

    @property
    def other(self) -> Supervisor:
        """The other supervisor."""
        return self.world.b if self is self.world.a else self.world.a

    @property
    def leads(self) -> bool:
        """Whether it lives and believes that it leads."""
        return self.alive and self.failover.role is Role.ACTIVE

    # ---------------------------------------------------------------- messages

    def on_drives(self, state: ActuatorState, stamp_ns: int, acting: Command) -> None:
        """The actuator end has reported."""
        self.failover.on_actuator(state, self.world.now_s)
        self.confirmations.on_report()
        self.publish(self.arbiter.on_drives(stamp_ns, acting, self.world.now_s))

    def on_samples(self, stamp_ns: int, values: tuple[float, ...]) -> None:
        """The sensors have measured."""
        for sensor, value in zip(REQUIRED, values, strict=True):
            self.publish(self.arbiter.on_sample(sensor, stamp_ns, value, self.world.now_s))

    def on_proposal(self, name: str, stamp_ns: int, command: Command, source: str) -> None:
        """A controller has proposed, and has seen a command of ``source`` before."""
        self.publish(
            self.arbiter.on_proposal(
                name, ProposalInput(stamp_ns, name, command), self.world.now_s
            )
        )
        self.publish(self.arbiter.on_status(name, (), source == name, self.world.now_s, source))

    def on_command(
        self, signature: Signature, stamp_ns: int, source: str, command: Command
    ) -> None:
        """A command was seen on the topic."""
        self.failover.on_command(signature, stamp_ns, source, command)
        self.publish([])

    def on_leader_state(
        self, signature: Signature, target: tuple[str, str], actual: Standing
    ) -> None:
        """The other one has reported its state."""
        if self.failover.on_leader_state(signature):
            self.arbiter.follow_operator(*target, {}, actual)
        self.publish([])

    def on_stop(self, stop: Stop) -> None:
        """Take another part's copy of the register."""
        self.failover.on_stop(stop)
        self.publish([])

    def wake(self, due_s: float) -> None:
        """The timer for the arbiter's next deadline."""
        if due_s == self._armed_s:
            self._armed_s = None
            self.publish(self.arbiter.on_time(self.world.now_s))

    def housekeep(self) -> None:
        """The timer of the housekeeping."""
        self.failover.rival_writer = self.other.alive and self.other.writes
        self.publish(self.arbiter.on_time(self.world.now_s))
        self.writes = self.failover.role is Role.ACTIVE or self.failover.unanswered > 0
        if self.world.now_s >= self._report_s:
            self._report_s = self.world.now_s + _REPORT_S
            self._report()
        self.world.at(self.world.now_s + _HOUSEKEEPING_S, self, "housekeep", is_timer=True)

    # ---------------------------------------------------------------- what is sent

    def publish(self, decisions: list[Decision]) -> None:
        """Send what may be sent, after every call of the arbiter."""
        world, failover = self.world, self.failover
        for decision in failover.pass_on(decisions, world.now_s):
            sent = (failover.signature, decision.stamp_ns, decision.source, decision.command)
            world.rules.sent(self.identity, decision.command)
            for target in ("end", "controllers", self.other.name):
                world.send(self.name, target, "on_command", *sent)
            world.at(world.now_s, self, "on_command", sent)
        self.look()
        if self._uncertain and failover.is_certain(world.now_s):
            world.at(world.now_s, self, "serve")
        self.confirmations.look(world.now_s)
        due_s = failover.wakeup_s
        if due_s is not None and due_s != self._armed_s:
            self._armed_s = due_s
            world.at(max(due_s, world.now_s + 1e-4), self, "wake", (due_s,))
        if self._reported != (self.arbiter.machine.revision, failover.role) or failover.asserting:
            self._report()

    def _report(self) -> None:
        """Publish the state if it leads."""
        machine, failover = self.arbiter.machine, self.failover
        if failover.role is Role.LISTENING:
            return
        self._reported = (machine.revision, failover.role)
        failover.asserting = False
        machine.events.clear()
        if failover.role is Role.ACTIVE:
            self._tell(self.other.name)

    def _tell(self, name: str) -> None:
        machine = self.arbiter.machine
        target = (machine.target, str(machine.target_mode))
        self.world.send(
            self.name, name, "on_leader_state", self.failover.signature, target, machine.standing
        )

    def greet(self, name: str) -> None:
        """Hand the latched messages to a process that has begun."""
        super().greet(name)
        if name == self.other.name and self.failover.role is Role.ACTIVE:
            self._tell(name)

    # ---------------------------------------------------------------- requests

    def on_request(self, request: Request) -> None:
        """An operator asks."""
        if request.reached:  # a service is called once
            return
        request.reached, request.by, request.ran_s = True, self.identity, self.world.now_s
        self.requests.append(request)
        self._uncertain.append(request)
        self.serve()

    def serve(self) -> None:
        """Act on the requests, once it is certain whether this supervisor leads."""
        if not self.failover.is_certain(self.world.now_s):
            return
        waiting, self._uncertain = self._uncertain, []
        for request in waiting:
            if self.failover.role is Role.ACTIVE:
                self._act(request)
            else:
                self._answer(request, False)

    def _act(self, request: Request) -> None:
        operator, now_s, kind = self.arbiter.operator, self.world.now_s, request.kind
        if kind == "switch":
            name = NAMES[self.arbiter.machine.active == NAMES[0]]
            switch = operator.ask_switch(name, False, SWITCH_S, "operator", now_s)
            self._take(request, name)
            switch.on_done = partial(self._switched, request, switch)
            if switch.done:
                self._switched(request, switch)
            self.publish([])
            return
        if kind == "acknowledge":
            ok, _ = operator.acknowledge("operator")
            confirm = self.confirmations.of_acknowledgement
        elif kind == "safe_stop":
            ok, _ = operator.ask_mode(kind, None, "operator")
            confirm = self.confirmations.of_stop
        else:
            ok, _ = operator.ask_mode(kind, self._manual, "operator")
            confirm = partial(self.confirmations.of_mode, Mode(kind))
        if not ok:
            self._answer(request, False)
            self.publish([])
            return
        self._take(request, {"acknowledge": "", "auto": "controller"}.get(kind, kind))
        waiting = confirm(now_s)
        waiting.on_done = partial(self._confirmed, request, waiting)
        self.publish([])

    @property
    def _manual(self) -> Command:
        applied = self.arbiter.applied or HOME
        return Command(80.0, applied.speed_rpm)

    def _take(self, request: Request, source: str) -> None:
        self.world.rules.taken(
            request, source, self.register.value, self.world.end.fence, self.world.now_s
        )

    def _switched(self, request: Request, switch: Any) -> None:
        if switch.ok and self.arbiter.machine.active == switch.name:
            waiting = self.confirmations.of_source(switch.name, self.world.now_s)
            waiting.on_done = partial(self._confirmed, request, waiting)
        else:
            request.shown = True  # it is only selected
            self._answer(request, switch.ok)

    def _confirmed(self, request: Request, waiting: Confirmation) -> None:
        self._answer(request, bool(waiting.ok))

    def _answer(self, request: Request, ok: bool) -> None:
        if request in self.requests:
            self.requests.remove(request)
        self.world.rules.answered(request, ok, self.world.now_s)
        self.world.answers.append(request)


class Page(Holder):
    """The operator's page: a copy of the register, and the requests of operators."""

    def begin(self) -> None:
        """Begin as a fresh process."""
        self.register, self._published = StopRegister(), None
        self.repeat()

    def ask(self, kind: str, name: str) -> Request:
        """Send a request to a supervisor."""
        request = Request(kind, self.world.now_s)
        if self.alive and not self.frozen:
            self.world.send(self.name, name, "on_request", request)
        return request

    def press(self) -> list[Request]:
        """Press the page's safe stop.

        It enters the page's copy, and both supervisors are asked.
        """
        if not self.alive or self.frozen:
            return []
        if not self.register.stopped:
            self.register.stop(
                StopCause.OPERATOR, "operator", round(self.world.now_s * NANOSECONDS)
            )
            self.look()
        return [self.ask("safe_stop", name) for name in SUPERVISORS]


class Controllers(Process):
    """Two controllers that go towards ``wish_kn`` and follow the commands that they see."""

    register = None
    wish_kn = HOME.force_kn

    def begin(self) -> None:
        """Begin as fresh processes."""
        self.applied = AppliedCommands(HOME)
        self._newest_ns: int | None = None
        self._heard_s = self.world.now_s

    def on_command(
        self, signature: Signature, stamp_ns: int, source: str, command: Command
    ) -> None:
        """A command was seen on the topic."""
        seen = AppliedCommand(stamp_ns, command, source, signature.leader, True, signature.term)
        if self.applied.add(seen, self._newest_ns, self.world.now_s):
            self._heard_s = self.world.now_s

    def on_samples(self, stamp_ns: int, acting: Command) -> None:
        """Propose to a measurement; after a silence from what the drives do."""
        self._newest_ns = stamp_ns
        if self.world.now_s - self._heard_s > 3.0 * TICK_S and refusal(acting) is None:
            self.applied, self._heard_s = AppliedCommands(acting), self.world.now_s
        self.world.at(self.world.now_s + _COMPUTE_S, self, "propose", (stamp_ns,))

    def propose(self, stamp_ns: int) -> None:
        """Send the proposals."""
        latest = self.applied.latest
        command = SETTINGS.drive_limits.clip(Command(self.wish_kn, HOME.speed_rpm), latest.command)
        for name in NAMES:
            self.world.broadcast(
                self.name, SUPERVISORS, "on_proposal", name, stamp_ns, command, latest.source
            )
