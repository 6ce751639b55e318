"""The parts of the stop register's model.

Values to enumerate, and what the real classes make of them.

Each function rebuilds the real objects from a value, calls them, and returns the value of their
new state. What they do not read is constant: stamps, times, the words of events. The search is in
``test/invariants/stop_model.py``.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple, cast

from fsw_control.cause import Cause
from fsw_control.contract import SAFE_STOP, Command
from fsw_control.fence import ActuatorState, Fence, Signature
from fsw_control.reason import Reason
from fsw_control.stop import Stop, StopCause, StopRegister
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.confirmation import Confirmations
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.state_machine import Machine, Mode
from fsw_supervisor.tick import Decision
from fsw_test_support.pair_settings import HOME, SETTINGS

#: source of the commands of a controller
CONTROL = "nmpc"


class End(NamedTuple):
    """The actuator end. Its counts of measurements are left out: it may react at any time."""

    value: Stop = Stop()
    unheard: bool = False  #: the value is a stop of its own that no other copy has shown
    term: int = 0
    leader: str = ""
    source: str = ""
    reacted: bool = False


class Supervisor(NamedTuple):
    """A supervisor. It may take over at any time; its role before that is standby."""

    identity: str
    active: bool = False
    term: int = 0
    reported: bool = False  #: the actuator end has reported
    heard_term: int = 0
    confirmed: bool = False
    value: Stop = Stop()
    unheard: bool = False  #: the value is a stop of its own that no other copy has shown
    agrees: bool = True  #: the last report had this copy's value
    safe: bool = False  #: its mode is safe stop; else it commands by a controller
    fresh: bool = True  #: it has neither sent a command nor followed one
    asked: Stop | None = (
        None  #: of a safe stop that is not answered yet, the copy's value after the request
    )
    acknowledged: bool = False  #: not known to it: somebody has acknowledged since that request


class Message(NamedTuple):
    """A command; the values in it are the same at each tick, so that it stands for all of them."""

    signature: Signature
    source: str


# ---------------------------------------------------------------- the actuator end


def _fence(end: End) -> Fence:
    fence = Fence()
    fence.register.value, fence.register._unheard = end.value, end.unheard
    fence._term, fence._leader, fence._source, fence._reacted = (
        end.term,
        end.leader,
        end.source,
        end.reacted,
    )
    return fence


def _end(fence: Fence) -> End:
    state = fence.state
    return End(
        state.stop,
        fence.register._unheard,
        state.term,
        state.leader,
        state.source,
        fence._reacted,
    )


def report(end: End) -> ActuatorState:
    """What the actuator end reports; of the source it only matters whether it is the safe stop."""
    state = _fence(end).state
    return state._replace(source=state.source if state.source == SAFE_STOP else "")


def receive(end: End, message: Message) -> tuple[End, End | None]:
    """Check a command.

    The actuator end if its gate refuses the command, and if it acts, None if the fence refuses.
    """
    fence = _fence(end)
    barred = fence.check(message.signature, message.source)
    refused = _end(fence)
    if barred:
        return refused, None
    fence.take(message.source, 0)
    return refused, _end(fence)


def end_hears(end: End, value: Stop) -> End:
    """Merge another part's copy, as ``StopHolder`` does."""
    fence = _fence(end)
    fence.hear(value)
    return _end(fence)


def react(end: End) -> End:
    """Begin a safe stop of its own."""
    fence = _fence(end)
    fence.stop(StopCause.WATCHDOG, 0)
    return _end(fence)


# ---------------------------------------------------------------- the page


def press(page: Stop) -> Stop:
    """The page's SAFE STOP, as ``hmi_node.py`` enters it.

    Of one epoch it is less than a supervisor's.
    """
    register = StopRegister()
    register.value = page
    if not register.stopped:
        register.stop(StopCause.OPERATOR, "Anna", 0)
    return register.value


# ---------------------------------------------------------------- a supervisor


class _Arbiter:
    """The arbiter's handling of stops and reports, with its state machine, and nothing that measures or proposes."""

    lockstep = False
    settings = SETTINGS

    def __init__(self) -> None:
        self.machine = Machine(SETTINGS)
        self.safety = SimpleNamespace(
            readmit=lambda who: None, tripped=False, why_stop=lambda acknowledged=False: None
        )
        self.registry = SimpleNamespace(get=lambda name: None)
        self.ticks: SimpleNamespace = SimpleNamespace(
            leading=False,
            last=None,
            present=SimpleNamespace(stamp_ns=0, answered=False),
            now_s=0.0,
            follow=lambda decision: setattr(self.ticks, "last", decision),
        )
        self._knew, self._end_restarted = (False, False), False
        self.in_force = SimpleNamespace(on_sent=lambda command: None)
        self._start_up = SimpleNamespace(on_status=lambda name, selected: None)

    def on_actuator(self, state: ActuatorState) -> None:
        Arbiter.on_actuator(cast(Arbiter, self), state)

    def on_stop(self, stop: Stop) -> None:
        Arbiter.on_stop(cast(Arbiter, self), stop)

    def on_source(self, source: str) -> None:
        Arbiter.on_source(cast(Arbiter, self), source)

    def follow(self, stamp_ns: int, source: str, command: Command) -> None:
        Arbiter.follow(cast(Arbiter, self), stamp_ns, source, command)

    def on_command(
        self, stamp_ns: int, source: str, command: Command, by_supervisor: bool
    ) -> None:
        self.on_source(source)

    def lead(self, unanswered: int = 0) -> list[Decision]:
        return [Decision(0, HOME, "")]

    def step_down(self) -> None:
        pass


class _Failover(Failover):
    """Takes over whenever it is asked to."""

    def _takes_over(self, now_s: float) -> bool:
        return True


class Rebuilt:
    """The real objects of a supervisor."""

    def __init__(self, before: Supervisor) -> None:
        self.before, self.arbiter = before, _Arbiter()
        machine = self.machine = self.arbiter.machine
        failover = self.failover = _Failover(cast(Any, self.arbiter), before.identity, True, 0.0)
        failover.role = Role.ACTIVE if before.active else Role.STANDBY
        failover.term, failover.heard_term, failover.confirmed = (
            before.term,
            before.heard_term,
            before.confirmed,
        )
        failover.actuator = ActuatorState() if before.reported else None
        machine.mode = Mode.SAFE_STOP if before.safe else Mode.AUTO
        self.waiting = None
        if before.asked is not None:
            machine.register.value = before.asked
            self.confirmations = Confirmations(failover, 0.0)
            self.waiting = self.confirmations.of_stop(0.0)
        machine.register.value, machine.register._unheard = before.value, before.unheard
        machine.reported = before.value if before.agrees else Stop(-1)
        if not before.fresh:
            self.arbiter.ticks.last = Decision(0, HOME, "")

    def value(self, **changes: Any) -> Supervisor:
        """The new state; a safe stop that was asked for is not waited for by a standby."""
        failover, machine = self.failover, self.machine
        active, own = failover.role is Role.ACTIVE, machine.register.value
        after = self.before._replace(
            active=active,
            term=failover.term,
            reported=failover.actuator is not None,
            heard_term=failover.heard_term,
            confirmed=failover.confirmed and active,
            value=own,
            unheard=machine.register._unheard,
            agrees=machine.reported == own,
            safe=machine.mode is Mode.SAFE_STOP,
            fresh=self.arbiter.ticks.last is None,
        )._replace(**changes)
        return (
            after
            if after.active and after.asked
            else after._replace(asked=None, acknowledged=False)
        )


def command(supervisor: Supervisor) -> Message | None:
    """What a supervisor sends at each tick."""
    if not supervisor.active:
        return None
    signature = Rebuilt(supervisor).failover.signature
    return Message(signature, SAFE_STOP if supervisor.safe else CONTROL)


def take_over(before: Supervisor) -> Supervisor:
    """Send under a new term from now on."""
    if before.active or not before.reported:
        return before
    rebuilt = Rebuilt(before)
    rebuilt.arbiter.ticks.last = rebuilt.failover.pass_on([], 0.0)[0]
    return rebuilt.value()


def hear_report(before: Supervisor, state: ActuatorState) -> tuple[Supervisor, bool]:
    """Take a report of the actuator end.

    Returns also whether a safe stop is answered with success now.
    """
    rebuilt = Rebuilt(before)
    rebuilt.failover.on_actuator(state, 0.0)
    if rebuilt.waiting is None:
        return rebuilt.value(), False
    heard = rebuilt.machine.register.value
    rebuilt.confirmations.on_report()
    if rebuilt.waiting.ok:
        return rebuilt.value(asked=None), True
    own = rebuilt.machine.register.value
    return (rebuilt.value(asked=own) if own != heard else rebuilt.value()), False


def hear_command(before: Supervisor, message: Message) -> Supervisor:
    """See a command on the topic."""
    rebuilt = Rebuilt(before)
    rebuilt.failover.on_command(message.signature, 0, message.source, HOME)
    return rebuilt.value()


def hear_stop(before: Supervisor, value: Stop) -> Supervisor:
    """Take another part's copy."""
    rebuilt = Rebuilt(before)
    rebuilt.failover.on_stop(value)
    return rebuilt.value()


def _operator(rebuilt: Rebuilt) -> OperatorRequests:
    return OperatorRequests(
        rebuilt.machine,
        cast(Any, rebuilt.arbiter.registry),
        cast(Any, rebuilt.arbiter.safety),
        False,
    )


def ask_stop(before: Supervisor) -> Supervisor:
    """An operator of its own asks the leader for a safe stop."""
    if not before.active or before.asked:
        return before
    rebuilt = Rebuilt(before)
    _operator(rebuilt).ask_mode(Mode.SAFE_STOP, None, before.identity)
    return rebuilt.value(asked=rebuilt.machine.register.value, acknowledged=False)


def acknowledge(before: Supervisor) -> Supervisor:
    """An operator acknowledges at the leader."""
    if not before.active:
        return before
    rebuilt = Rebuilt(before)
    _operator(rebuilt).acknowledge("operator")
    return rebuilt.value()


def ask_auto(before: Supervisor) -> Supervisor:
    """An operator asks the leader for control by a controller, which is ready."""
    if not before.active or not Rebuilt(before).machine.acknowledged:
        return before
    rebuilt = Rebuilt(before)
    rebuilt.machine.fire(Cause.OPERATOR_AUTO, Reason(), "operator", CONTROL)
    return rebuilt.value()
