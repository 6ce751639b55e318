"""What the operator asks for: another controller, another mode; and the answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite

from fsw_control.contract import Command
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.state_machine import OPERATOR_TRIGGERS, Level, Machine, Mode
from fsw_supervisor.tick import ProposalInput, check


@dataclass(slots=True)
class SwitchRequest:
    """A wish to change the active controller.

    Attributes
    ----------
    name : str
        The controller wanted.
    strict : bool
        Refuse unless it is ready now.
    expires_s : float
        Steady time at which a best-effort request gives up.
    last_tick : int
        Likewise as the number of a tick (in lockstep, where the steady clock means nothing).
    who : str
        Who asked.
    accepted : bool
        Whether it was ready once, so that the swap follows at the next tick.
    done, ok : bool
        Whether it is answered, and how.
    message : str
        The answer in words.
    """

    name: str
    strict: bool
    expires_s: float
    last_tick: int
    who: str
    accepted: bool = False
    done: bool = False
    ok: bool = False
    message: str = ""
    _listeners: list[Callable[[SwitchRequest], None]] = field(default_factory=list)

    def answer(self, ok: bool, message: str) -> None:
        """Answer the request; only the first answer counts."""
        if self.done:
            return
        self.done, self.ok, self.message = True, ok, message
        for listener in self._listeners:
            listener(self)

    def when_done(self, listener: Callable[[SwitchRequest], None]) -> None:
        """Call ``listener`` with the request as soon as it is answered (now, if it is)."""
        if self.done:
            listener(self)
        else:
            self._listeners.append(listener)


_NOTHING = Command(float("nan"), float("nan"))


class OperatorRequests:
    """Takes requests, says why not, and serves them between two ticks.

    Parameters
    ----------
    machine : Machine
        Whose mode and controller are asked for.
    registry : ControllerRegistry
        Who is ready.
    safety : SafetyMonitor
        Auto is refused while an interlock is tripped.
    lockstep : bool
        Whether time-outs count in ticks.

    Attributes
    ----------
    manual : Command or None
        The operator's values for manual.
    """

    def __init__(self, machine: Machine, registry: ControllerRegistry, safety: SafetyMonitor, lockstep: bool) -> None:
        self.manual: Command | None = None
        self._machine = machine
        self._registry = registry
        self._safety = safety
        self._lockstep = lockstep
        self._pending: SwitchRequest | None = None

    def begin_manual_at(self, values: Command | None) -> None:
        """Let manual begin with these values, until the operator gives others."""
        self.manual = values

    @property
    def waiting(self) -> bool:
        """Whether a switch is asked for and has not been made."""
        return self._pending is not None

    def ask_switch(self, name: str, strict: bool, timeout_s: float, who: str, now_s: float) -> SwitchRequest:
        """Ask for a controller; the answer is in the request returned, at once or later.

        Parameters
        ----------
        name : str
            The controller wanted.
        strict : bool
            Refuse unless it is ready now; otherwise wait up to ``timeout_s``.
        timeout_s : float
            0: answer at once.
        who : str
            Who asks, for the log.
        now_s : float
            Steady time.
        """
        machine = self._machine
        timeout_s = timeout_s if isfinite(timeout_s) and timeout_s > 0.0 else 0.0
        last_tick = machine.tick + machine.settings.ticks(timeout_s)
        request = SwitchRequest(name, strict, now_s + timeout_s, last_tick, who)
        if self._registry.get(name) is None:
            known = ", ".join(record.name for record in self._registry) or "none"
            return self._answer(request, False, f"refused: unknown controller {name[:40]!r}; known: {known}")
        if self._pending is not None:
            self._drop(f"superseded by a request for {name}")
        if machine.mode is Mode.AUTO and name == machine.active:
            machine.want(name)
            return self._answer(request, True, f"{name} is active already")
        obstacle = self._obstacle(name)
        if obstacle and (strict or timeout_s == 0.0):
            return self._answer(request, False, f"refused: {obstacle}")
        machine.want(name)
        if machine.mode is not Mode.AUTO:
            text = f"{name} is selected; the mode is {machine.mode}: it is applied when auto begins"
            return self._answer(request, True, text)
        request.accepted = not obstacle
        self._pending = request
        if timeout_s == 0.0:
            self._answer(request, True, f"accepted: {name} is applied from the next tick on")
        return request

    def ask_mode(self, mode: str, manual: Command | None, who: str) -> tuple[bool, str]:
        """Ask for ``auto``, ``manual`` (with values), ``hold`` or ``safe_stop``; returns whether, and why in words."""
        ok, message = self._ask_mode(mode, manual, who)
        if not ok:
            self._machine.log(Level.WARN, who, f"mode {mode[:40]}: {message}")
        return ok, message

    def _ask_mode(self, mode: str, manual: Command | None, who: str) -> tuple[bool, str]:
        machine = self._machine
        wanted = next((item for item in OPERATOR_TRIGGERS if item == mode), None)
        if wanted is None:
            return False, f"refused: unknown mode {mode[:40]!r}; known: {', '.join(OPERATOR_TRIGGERS)}"
        controller = ""
        if wanted is Mode.MANUAL:
            proposal = ProposalInput(0, "manual", manual if manual is not None else _NOTHING)
            verdict = check("manual", proposal, None, machine.settings.limits)
            if not verdict.ok:
                return False, f"refused: {verdict.reason}"
            self.manual = verdict.command
        if wanted is Mode.AUTO:
            if self._safety.tripped:
                return False, f"refused: interlock {', '.join(self._safety.tripped)} is tripped"
            self._registry.readmit_all(who)
            controller = machine.active or self._registry.first_ready()
            if not controller:
                return False, f"refused: {self._registry.obstacle(machine.target)}"
        machine.want(mode=wanted)
        if wanted is machine.mode:
            return True, f"{wanted} already"
        if wanted is not Mode.AUTO and self._pending is not None:
            self._drop(f"refused: the mode has become {wanted}")
        machine.fire(OPERATOR_TRIGGERS[wanted], f"{who} asked for {wanted}", who, controller)
        return True, f"{wanted} from the next command on" + (f", with {controller}" if controller else "")

    def serve(self, now_s: float) -> None:
        """Make the swap that is asked for, if it can be made; to be called between two ticks."""
        self.expire(now_s)
        request = self._pending
        if request is None:
            return
        if self._machine.mode is not Mode.AUTO:
            self._drop(f"refused: the mode has become {self._machine.mode}")
            return
        obstacle = self._obstacle(request.name)
        if not obstacle:
            request.accepted = True
            if request.name != self._machine.active:
                self._machine.swap(
                    request.name, f"{request.who} asked for {request.name}", request.who, automatic=False
                )
        elif request.strict or request.done:
            self._drop(f"refused: {obstacle}")

    def expire(self, now_s: float) -> None:
        """Give up a request that has waited long enough."""
        request = self._pending
        if request is None or request.done:
            return
        guard_s = self._machine.settings.lockstep_deadline_s if self._lockstep else 0.0
        late = self._lockstep and self._machine.tick > request.last_tick
        if late or now_s > request.expires_s + guard_s:
            self._drop(f"timed out: {self._obstacle(request.name) or 'no measurement came to swap at'}")

    def applied(self, source: str, stamp_s: float) -> None:
        """Note whose command has been sent."""
        request = self._pending
        if request is not None and request.name == source:
            self._pending = None
            self._answer(request, True, f"{source} is applied from {stamp_s:.3f} s on")

    def dismiss(self, message: str) -> None:
        """Refuse what is waiting."""
        self._drop(message)

    def failed(self, name: str, reason: str) -> None:
        """Note that ``name`` has failed while active."""
        if self._pending is not None and self._pending.name == name:
            self._drop(f"swapped, but {reason}")

    def _obstacle(self, name: str) -> str:
        obstacle = self._registry.obstacle(name)
        elapsed = self._machine.ticks_since_asked
        interval = self._machine.settings.ticks(self._machine.settings.switch_interval_s)
        if not obstacle and self._machine.mode is Mode.AUTO and elapsed < interval and name != self._machine.active:
            return f"the last swap was only {elapsed} ticks ago"
        return obstacle

    def _drop(self, message: str) -> None:
        request, self._pending = self._pending, None
        if request is None:
            return
        if self._machine.target == request.name and self._machine.active:
            self._machine.want(self._machine.active)
        self._answer(request, False, message)

    def _answer(self, request: SwitchRequest, ok: bool, message: str) -> SwitchRequest:
        if not request.done or not ok:
            level = Level.INFO if ok else Level.WARN
            self._machine.log(level, request.who, f"switch to {request.name[:40]}: {message}")
        request.answer(ok, message)
        return request
