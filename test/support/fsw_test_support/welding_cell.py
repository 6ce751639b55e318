"""A welding cell of pure cores.

Arbiter, gateway and watchdog, with small models of machine, controllers and operator.

A *letter* changes one condition of the cell or is one request of the operator; then one tick
passes. What must hold after every tick, whatever the letters before, is checked in :class:`Rules`;
a broken rule raises :class:`BrokenRuleError`.
"""

from __future__ import annotations

import copyreg
from collections.abc import Callable
from functools import partial
from math import isfinite, nan
from typing import Any

from fsw_control import weld
from fsw_control.command_gate import refusal
from fsw_control.contract import Command
from fsw_control.fence import Signature
from fsw_control.sensors import REQUIRED
from fsw_control.units import NANOSECONDS
from fsw_control.validity import Frozen, sensor_limits
from fsw_machine.gateway import Gateway
from fsw_model import nominal
from fsw_plant import PlantConfig
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import interlocks_from
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import GAP_S, Decision, ProposalInput
from fsw_test_support.plc import MACHINE, Plc, new_gateway
from fsw_test_support.short_times import HOME, NAMES, SUPERVISOR, TORQUE_NM_PER_KN

TICK_NS = round(weld.TICK_S * NANOSECONDS)
MANUAL = Command(88.0, 430.0)  #: where the operator's hand wants to be, ten moves away
#: what the thermocouple shows [degC]; None: no sample
TEMPERATURES_C: dict[str, float | None] = {
    "good": 885.0,
    "warn": 905.0,
    "trip": 920.0,
    "bad": nan,
    "beyond": 1100.0,
    "missing": None,
}
#: what is wrong with the candidate command of the first controller; with ``none`` no controller
#: answers
CANDIDATES = ("well", "late", "nan", "jump", "none")
REQUESTS = ("auto", "manual", "hold", "safe_stop", "switch", "acknowledge")
LINKS = ("lost", "restored", "dropped", "delivered", "forward", "back", "push", "released")
#: another supervisor in place of this one, which knows only what it hears: drives, sensors and the
#: controllers' status
RESTART = "restart"
ALPHABET = ("tick", *TEMPERATURES_C, *CANDIDATES, *REQUESTS, *LINKS, RESTART)
#: what a load cell sees besides the set-points when something pushes: three moves
_PUSH_KN = 3.0
#: ticks of a switch request until it must be answered: its time-out, and the tick in which that is
#: noticed
_ANSWER_TICKS = 5
_SWITCH_TIMEOUT_S = 0.3
_SUPERVISOR = SUPERVISOR | {
    "start_timeout_s": 1.0,
    "hold_timeout_s": 0.4,
    "operator_hold_timeout_s": 0.6,
    "storm_swaps": 3,
    "storm_window_s": 1.0,
    "validity.frozen_samples": 0,
}
_PLANT = {
    "watchdog": {
        "timeout_s": 0.2,
        "hold_s": 0.1,
        "safe_force_kn": 70.0,
        "safe_rate_kn_per_s": 20.0,
    }
}
SETTINGS = SupervisorParameters.from_values(_SUPERVISOR)
#: after this, to the nearest tick, a manual mode without a valid sensor ends
_BLIND_S = SETTINGS.operator_hold_timeout_s - SETTINGS.tick_period_s / 2.0
_BLIND_TICKS = round(SETTINGS.operator_hold_timeout_s / SETTINGS.tick_period_s)
#: ticks after which a level of an interlock takes effect
_LASTING_TICKS = round(SETTINGS.interlocks.persistence_s / SETTINGS.tick_period_s)
_CONFIG = PlantConfig.from_values(_PLANT)
_SHARED: list[Any] = [
    SETTINGS,
    SETTINGS.drive_limits,
    MACHINE,
    _CONFIG,
    *sensor_limits(SETTINGS.flat()).values(),
    *interlocks_from(SETTINGS.flat()),
    nominal(),
]


def _shared(index: int) -> object:
    return _SHARED[index]


# A copy of a cell shares what never changes. Signals without noise are never judged to be frozen,
# so that what has been learnt of their noise does not matter.
for _kind in {type(shared) for shared in _SHARED}:
    copyreg.pickle(_kind, lambda shared: (_shared, (_SHARED.index(shared),)))
copyreg.pickle(Frozen, lambda _: (Frozen, ()))


#: a message on its way to the arbiter; takes the time of its arrival
_Message = Callable[[float], list[Decision]]


class BrokenRuleError(AssertionError):
    """A rule is broken; ``rule`` is its name."""

    def __init__(self, rule: str, words: str) -> None:
        super().__init__(f"{rule}: {words}")
        self.rule = rule


class Cell:
    """The cell.

    Without ``gateway`` the drives take every command that is not dropped, and stamps can jump.

    Attributes
    ----------
    plc : Plc
        The machine; without ``gateway`` it stands for the plant.
    control : int
        Ticks in a row in which a controller's command came into force.
    """

    def __init__(self, gateway: bool = True) -> None:
        self.arbiter = _new_arbiter()
        self.gateway: Gateway | None = None
        if gateway:
            self.gateway = new_gateway()
            self.gateway.on_connected()
        self.plc = Plc(_CONFIG, HOME)
        self.temperature, self.candidate = "good", "well"
        self.linked = self.delivering = True
        self.pushed_kn = 0.0
        # No later: in seconds, stamps of today's date are off by 0.1 us, and whether 0.3 s are
        # over would be chance.
        self.now_s, self.clock_ns = 100.0, 10**15
        self.stamp_ns = 0
        self.followed, self.source = (
            HOME,
            "",
        )  #: the last command that the controllers have seen, and whose it was
        self.control = 0
        self.rules = Rules()

    def step(self, letter: str = "tick", rank: int = 0) -> Decision | None:
        """Let one tick pass after ``letter``; ``rank`` says in which order its messages arrive.

        Returns the tick's command.

        Raises
        ------
        BrokenRuleError
            When a rule does not hold.
        """
        self.now_s += weld.TICK_S
        self.clock_ns += TICK_NS
        self._change(letter)
        self.plc.cycle()
        published = self._read()
        decisions = (
            self._tick(*published, rank)
            if published is not None
            else self._wait(self.now_s + 0.0999)
        )
        self._deliver(decisions)
        self.rules.after_tick(self, decisions, published is not None)
        return decisions[-1] if decisions else None

    # ---------------------------------------------------------------- the letters

    def _change(self, letter: str) -> None:
        if letter in TEMPERATURES_C:
            self.temperature = letter
        elif letter in CANDIDATES:
            self.candidate = letter
        elif letter in REQUESTS:
            self._ask(letter)
        elif letter in ("forward", "back"):
            self.clock_ns += (3600 if letter == "forward" else -3600) * NANOSECONDS
            self.rules.clock_jumped()
        elif letter == RESTART:
            self.arbiter = _new_arbiter()
            self.rules.restarted()
        elif letter in ("push", "released"):
            self.pushed_kn = _PUSH_KN if letter == "push" else 0.0
        elif letter in ("dropped", "delivered"):
            self.delivering = letter == "delivered"
        elif letter in ("lost", "restored"):
            changed, self.linked = self.linked != (letter == "restored"), letter == "restored"
            if changed and self.gateway is not None:
                (self.gateway.on_connected if self.linked else self.gateway.on_lost)()

    def is_already(self, letter: str) -> bool:
        """Whether ``letter`` is a condition that lasts, so that it would be the same as ``tick``."""
        if letter in ("push", "released"):
            return (letter == "push") == (self.pushed_kn != 0.0)
        if letter in ("dropped", "delivered"):
            return (letter == "delivered") == self.delivering
        if letter in ("lost", "restored"):
            return (letter == "restored") == self.linked
        return letter in (self.temperature, self.candidate)

    def _ask(self, letter: str) -> None:
        operator, machine = self.arbiter.operator, self.arbiter.machine
        if letter == "acknowledge":
            listed = operator.acknowledgement_blocked_by
            self.rules.acknowledged(operator.acknowledge("operator")[0], listed, machine.mode)
        elif letter == "switch":
            name = NAMES[machine.active == NAMES[0]]
            request = operator.ask_switch(name, False, _SWITCH_TIMEOUT_S, "operator", self.now_s)
            self.rules.asked(request)
        else:
            ok, _ = operator.ask_mode(letter, MANUAL if letter == "manual" else None, "operator")
            self.rules.answered(letter, ok, machine.mode)

    # ---------------------------------------------------------------- the machine

    @property
    def in_force(self) -> Command:
        """Set-points in force at the drives, which follow at once."""
        return self.plc.in_force

    def _read(self) -> tuple[int, Command] | None:
        """Stamp and drives' feedback of the cycle; None where it is not published."""
        if not self.linked:
            return None
        if self.gateway is None:
            self.stamp_ns = self.clock_ns
            return self.stamp_ns, self.acting
        read = self.plc.read(self.clock_ns, self.now_s, self.acting)
        out = self.gateway.on_read(read)
        if out is None:
            return None
        self.stamp_ns = out.stamp_ns
        return out.stamp_ns, out.drives

    @property
    def acting(self) -> Command:
        """What the drives report."""
        return self.in_force._replace(force_kn=self.in_force.force_kn + self.pushed_kn)

    def _deliver(self, decisions: list[Decision]) -> None:
        """The commands reach controllers and machine."""
        came = False
        for decision in decisions:
            self.arbiter.on_command(decision.stamp_ns, decision.source, decision.command)
            self.followed, self.source = decision.command, decision.source
            if not (self.delivering and self.linked):
                continue
            order = None
            if self.gateway is not None:
                at_s = self.now_s + 0.09
                signature = Signature(1, "supervisor", self.arbiter.machine.register.value)
                order = self.gateway.on_command(
                    decision.command, decision.stamp_ns, decision.source, True, at_s, signature
                )
                if order is None:
                    continue
                self.rules.written(order.command, self.in_force)
                self.gateway.on_written(order, "", at_s)
            self.plc.take(decision.command if order is None else order.command)
            came = decision.source in NAMES and self.in_force == decision.command
        self.control = self.control + 1 if came else 0

    # ---------------------------------------------------------------- one tick

    def _tick(self, stamp_ns: int, drives: Command, rank: int) -> list[Decision]:
        """All messages of a tick within 10 ms, in the order of number ``rank``.

        Then time until the next tick.
        """
        arbiter = self.arbiter
        messages: list[_Message] = [partial(arbiter.on_drives, stamp_ns, drives)]
        late: list[_Message] = []
        torque_nm = 980.0 + TORQUE_NM_PER_KN * (drives.force_kn - HOME.force_kn)
        for sensor, value in zip(
            REQUIRED, (2.66, torque_nm, TEMPERATURES_C[self.temperature]), strict=True
        ):
            if value is not None:
                messages.append(partial(arbiter.on_sample, sensor, stamp_ns, value))
        for name in NAMES if self.candidate != "none" else ():
            kind = self.candidate if name == NAMES[0] else "well"
            proposal = ProposalInput(stamp_ns, name, self._proposed(kind))
            (late if kind == "late" else messages).append(
                partial(arbiter.on_proposal, name, proposal)
            )
            messages.append(partial(self._tell_status, name))
        decisions, at_s = list[Decision](), self.now_s
        if self.gateway is not None:
            arbiter.on_actuator(self.gateway.fence.state)
        for message in permuted(messages, rank):
            at_s += 0.001
            decisions += message(at_s)
        decisions += self._wait(self.now_s + 0.09)
        for message in late:
            decisions += message(self.now_s + 0.09)
        return decisions + self._wait(self.now_s + 0.0999)

    def _tell_status(self, name: str, at_s: float) -> list[Decision]:
        return self.arbiter.on_status(name, (), self.source == name, at_s, self.source)

    def _proposed(self, kind: str) -> Command:
        if kind == "nan":
            return Command(nan, nan)
        if kind == "jump":
            return self.followed._replace(force_kn=self.followed.force_kn - 1.5)
        return SETTINGS.drive_limits.clip(HOME, self.followed)

    def _wait(self, until_s: float) -> list[Decision]:
        decisions = list[Decision]()
        while (at_s := self.arbiter.wakeup_s) is not None and at_s <= until_s:
            decisions += self.arbiter.on_time(at_s)
        return decisions + self.arbiter.on_time(until_s)

    # ---------------------------------------------------------------- back to health

    def heal(self) -> Decision | None:
        """One tick of a cell in which all is well again and the operator wants auto."""
        self.temperature, self.candidate, self.delivering = "good", "well", True
        mode = self.arbiter.machine.mode
        if not self.linked:
            return self.step("restored")
        if mode is Mode.SAFE_STOP and not self.arbiter.machine.acknowledged:
            return self.step("acknowledge")
        return self.step("tick" if mode is Mode.AUTO else "auto")


def _new_arbiter() -> Arbiter:
    arbiter = Arbiter(SETTINGS)
    for name in NAMES:
        arbiter.registry.join(name)
    return arbiter


def permuted(items: list[Any], rank: int) -> list[Any]:
    """The permutation of number ``rank``; 0: as given."""
    left, out = list(items), []
    while left:
        rank, index = divmod(rank, len(left))
        out.append(left.pop(index))
    return out


class Rules:
    """What must hold in every cell after every tick.

    It judges by what the cell shows, not by the arbiter's books.
    """

    forgiven: frozenset[str] = (
        frozenset()
    )  #: rules that are not checked, to see what else is broken

    def __init__(self) -> None:
        #: a trip has lasted, and as many good samples without it have not been seen since
        self.cause = False
        self.to_acknowledge = False  #: a safe stop has begun and nobody has acknowledged it
        self._trips = 0  #: ticks that good samples in a row beyond the trip cover
        self._free = 0  #: the same without it
        self._perhaps = 0  #: as the trips, with samples in between that say nothing
        self._measured_s = 0.0  #: last measurement
        self._reacted, self._stopped = False, True
        self._blind_s: float | None = None  #: since when the thermocouple may not be used
        self._blind_manual = 0  #: those in manual since it was asked for last
        self._mode = Mode.START
        self._asked_for = ""
        self._command: Command | None = None
        self._waiting: list[tuple[Any, int]] = []
        self._source = ""  #: of the last command
        self._new = False  #: a supervisor that has not commanded yet
        self._told = False  #: it has been told of a safe stop by then

    def restarted(self) -> None:
        """Judge a supervisor that has seen nothing yet, and that only the controllers can tell of a safe stop."""
        self._new, self._told = True, False
        self.cause = self.to_acknowledge = False
        self._trips = self._free = self._perhaps = 0
        self._mode, self._waiting = Mode.START, []

    def clock_jumped(self) -> None:
        self._trips = 0

    def asked(self, request: Any) -> None:
        self._waiting.append((request, 0))

    def acknowledged(self, ok: bool, listed: tuple[str, ...], mode: Mode) -> None:
        self.to_acknowledge = self.to_acknowledge and not ok
        if mode is Mode.SAFE_STOP and ok is bool(listed):
            words = f"the answer is {ok}, listed are {listed}"
            self._broken("what refuses an acknowledgement is listed", words)

    def answered(self, request: str, ok: bool, mode: Mode) -> None:
        if ok and mode != request:
            self._broken(
                "every request is answered", f"{request} was accepted, the mode is {mode}"
            )
        self._asked_for = request if ok else ""
        self.to_acknowledge |= self._asked_for == Mode.SAFE_STOP
        self._blind_manual = 0 if ok else self._blind_manual
        self._check_mode(mode, was_blind_for_long=False)

    def written(self, command: Command, in_force: Command) -> None:
        wrong = refusal(command, SETTINGS.drive_limits, in_force)
        if wrong is not None:
            self._broken(
                "one move from what acts", f"the gateway writes {command}, in force is {in_force}"
            )

    def after_tick(self, cell: Cell, decisions: list[Decision], measured: bool) -> None:
        arbiter = cell.arbiter
        if self._new and measured and cell.candidate != "none" and self._source == Mode.SAFE_STOP:
            self._told = True  # unless it is acknowledged, which the gateway remembers
            self.to_acknowledge |= cell.gateway is None or cell.gateway.fence.register.stopped
        # A time-out ends a mode before the samples of the tick are judged.
        blind_before = self._blind_s is not None and cell.now_s - self._blind_s > _BLIND_S
        self._sense(cell, measured)
        # A machine that has moved by itself: the gateway's own safe stop.
        self._reacted = cell.gateway is not None and cell.gateway.fence.register.stopped
        self._stopped = cell.arbiter.machine.register.stopped
        self._check_mode(arbiter.machine.mode, blind_before)
        self._check_blind(arbiter.machine.mode, measured)
        self._asked_for = ""
        if len(decisions) > 1 or any(sent.stamp_ns != cell.stamp_ns for sent in decisions):
            self._broken(
                "one command per tick", f"{[(sent.stamp_ns, sent.source) for sent in decisions]}"
            )
        if (
            measured
            and not decisions
            and self._command is not None
            and arbiter.applied is not None
        ):
            self._broken("one command per tick", f"none, {arbiter.machine.reason.words}")
        for decision in decisions:
            self._check_command(decision, cell)
        for request, age in self._waiting:
            if age > _ANSWER_TICKS and not request.done:
                self._broken(
                    "every request is answered",
                    f"switch to {request.name} was asked {age} ticks ago",
                )
        self._waiting = [(pending, age + 1) for pending, age in self._waiting if not pending.done]

    def _check_command(self, decision: Decision, cell: Cell) -> None:
        if refusal(decision.command, SETTINGS.drive_limits) is not None:
            self._broken("inside the bounds", f"{decision.command}")
        near = [
            before for before in (self._command, cell.in_force, cell.acting) if before is not None
        ]
        if cell.gateway is not None or cell.arbiter.in_force._just_begun:
            # After a pause a push may be taken off the set-points once, or after it has ended in a
            # gap: what drives report cannot tell. A gateway then refuses the command.
            near.append(cell.in_force._replace(force_kn=cell.in_force.force_kn - _PUSH_KN))
        # Of commands that do not arrive, only the actuator end can tell a fresh supervisor: see
        # supervisor_pair.py.
        arrives = cell.gateway is not None or cell.delivering
        if arrives and all(
            refusal(decision.command, SETTINGS.drive_limits, before) for before in near
        ):
            self._broken(
                "one move from what acts", f"{decision.source} {decision.command}, before: {near}"
            )
        if self.cause and decision.source != "safe_stop":
            self._broken("a cause leads to the safe state", f"the command is of {decision.source}")
        if self._told and decision.source != "safe_stop":
            self._broken(
                "a restart goes on with a safe stop", f"the first command is of {decision.source}"
            )
        self._command, self._source = decision.command, decision.source
        self._new = self._told = False

    def _sense(self, cell: Cell, measured: bool) -> None:
        """Whether there is a cause.

        A value that is not valid cannot say that it is gone, only that it is there.
        """
        value = TEMPERATURES_C[cell.temperature]
        ticks = self._covered_ticks(cell.now_s) if measured else 0
        known = measured and not cell.arbiter.safety.sensor_flaws["thermocouple"]
        beyond = (
            value is not None
            and isfinite(value)
            and value >= SETTINGS.interlocks.temperature_high.trip
        )
        if known or (measured and beyond):
            lasting = _LASTING_TICKS
            self._trips = (
                min(self._trips + (ticks if self._trips else 1), lasting) if beyond else 0
            )
            self._perhaps = (
                min(self._perhaps + (ticks if self._perhaps else 1), lasting) if beyond else 0
            )
            self._free = (
                self._free + (ticks if self._free else 1) if self.cause and not beyond else 0
            )
            self.cause = self._free < lasting if self.cause else self._trips >= lasting
            self.to_acknowledge |= self.cause
        elif measured:
            self._perhaps += ticks if self._perhaps else 0
        if measured:
            if "thermocouple" not in cell.arbiter.safety.invalid_sensors:
                self._blind_s = None
            elif self._blind_s is None:
                self._blind_s = cell.now_s
            self.to_acknowledge |= self._blind_s is not None

    def _covered_ticks(self, now_s: float) -> int:
        """Ticks since the measurement before, which a sample covers; one after a gap."""
        elapsed_s, self._measured_s = now_s - self._measured_s, now_s
        return round(elapsed_s / weld.TICK_S) if elapsed_s < GAP_S + weld.TICK_S / 2.0 else 1

    def _check_blind(self, mode: Mode, measured: bool) -> None:
        if mode is not Mode.MANUAL or self._blind_s is None:
            self._blind_manual = 0
        elif measured:
            self._blind_manual += 1
            if self._blind_manual > _BLIND_TICKS + 1:
                self._broken(
                    "a blind manual mode ends", f"it has lasted for {self._blind_manual} ticks"
                )

    def _check_mode(self, mode: Mode, was_blind_for_long: bool) -> None:
        before, self._mode = self._mode, mode
        if self.cause and mode is not Mode.SAFE_STOP:
            self._broken(
                "a cause leads to the safe state", f"the mode is {mode} ({before} before)"
            )
        if before is Mode.SAFE_STOP and mode is not before and self.to_acknowledge:
            self._broken("leaving a safe stop needs an acknowledgement", f"{mode} without one")
        if mode is Mode.SAFE_STOP and before is not mode:
            self.to_acknowledge |= self._stopped
            blind = before is Mode.MANUAL and was_blind_for_long
            timed_out = before in (Mode.HOLD, Mode.START) or blind
            resumed = self._told or (self._new and self._source == mode)
            expected = timed_out or resumed or self._reacted or self._asked_for == mode
            if not (expected or self._perhaps >= _LASTING_TICKS):
                self._broken(
                    "only a lasting trip stops", f"after {self._perhaps} ticks beyond the trip"
                )

    def _broken(self, rule: str, words: str) -> None:
        if rule not in self.forgiven:
            raise BrokenRuleError(rule, words)
