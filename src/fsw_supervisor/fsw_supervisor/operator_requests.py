"""Operator requests for another controller or mode, and their answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, nan

from fsw_control.cause import Cause
from fsw_control.command_check import refusal
from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_control.units import NANOSECONDS
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.state_machine import OPERATOR_TRIGGERS, Level, Machine, Mode


@dataclass(slots=True)
class SwitchRequest:
    """A request to change the active controller."""

    name: str  #: of the controller
    strict: bool  #: refuse unless it is ready
    expires_s: float  #: steady time at which a best-effort request gives up
    #: the same on the clock of ``Machine.time_ns`` (for lockstep, where the steady clock is only a
    #: guard)
    expires_ns: int
    who: str  #: the requesting operator
    done: bool = False  #: answered
    ok: bool = False
    message: str = ""  #: text of the answer
    on_done: Callable[[], object] | None = None  #: called after the answer

    def answer(self, ok: bool, message: str) -> None:
        """Answer the request; only the first answer counts."""
        if self.done:
            return
        self.done, self.ok, self.message = True, ok, message
        if self.on_done is not None:
            self.on_done()


@dataclass(slots=True)
class OperatorRequests:
    """Checks requests and serves them between ticks; lockstep time-outs count on the stamps."""

    machine: Machine
    registry: ControllerRegistry
    safety: SafetyMonitor
    lockstep: bool
    manual: Command | None = None  #: values of the manual mode
    _pending: SwitchRequest | None = None
    _swapped_ns: int | None = None

    @property
    def waiting(self) -> bool:
        """Whether a requested switch is pending."""
        return self._pending is not None

    def ask_switch(
        self, name: str, strict: bool, timeout_s: float, who: str, now_s: float
    ) -> SwitchRequest:
        """Request a controller; the returned request holds the answer, at once or later.

        A ``strict`` request is refused unless the controller is ready now; otherwise the request
        waits for up to ``timeout_s``. With a time-out of 0 the answer comes at once. ``who`` is
        the operator, for the log.
        """
        machine = self.machine
        timeout_s = timeout_s if isfinite(timeout_s) and timeout_s > 0.0 else 0.0
        expires_ns = machine.time_ns + round(timeout_s * NANOSECONDS)
        request = SwitchRequest(name, strict, now_s + timeout_s, expires_ns, who)
        if self.registry.get(name) is None:
            known = ", ".join(record.name for record in self.registry) or "none"
            return self._answer(
                request, False, f"unknown controller {name[:40]!r}; known: {known}"
            )
        self.drop(f"superseded by a request for {name}")
        if machine.mode is Mode.AUTO and name == machine.active:
            machine.set_target(name)
            return self._answer(request, True, f"{name} is active already")
        why_not = self._why_not(name)
        if why_not and (strict or timeout_s == 0.0):
            return self._answer(request, False, f"{why_not}")
        machine.set_target(name)
        if machine.mode is not Mode.AUTO:
            text = (
                f"{name} is selected; the mode is {machine.mode}: it is applied when auto begins"
            )
            return self._answer(request, True, text)
        self._pending = request
        if timeout_s == 0.0:
            self._answer(request, True, f"accepted: {name} is applied from the next tick on")
        return request

    def ask_mode(self, mode: str, manual: Command | None, who: str) -> tuple[bool, str]:
        """Request one of ``OPERATOR_MODES`` (``manual`` with values); return success and text."""
        ok, message = self._ask_mode(mode, manual, who)
        if not ok:
            self.machine.log(Level.WARN, who, f"mode {mode[:40]}: {message}")
        return ok, message

    def _ask_mode(self, mode: str, manual: Command | None, who: str) -> tuple[bool, str]:
        machine, controller = self.machine, ""
        if mode not in OPERATOR_TRIGGERS:
            return False, f"unknown mode {mode[:40]!r}; known: {', '.join(OPERATOR_TRIGGERS)}"
        wanted = Mode(mode)
        if wanted is not Mode.SAFE_STOP and (why_stop := self.safety.why_stop()):
            return False, f"{why_stop}"
        if (
            wanted is not Mode.SAFE_STOP
            and machine.mode is Mode.SAFE_STOP
            and not machine.acknowledged
        ):
            return False, "acknowledge the safe stop first (fsw/acknowledge, fsw.py acknowledge)"
        if wanted is Mode.MANUAL:
            manual = manual or Command(nan, nan)
            refused = refusal(manual, machine.settings.limits)
            if refused is not None:
                return False, f"{refused.words}"
            self.manual = manual
        if wanted is Mode.AUTO:
            self.registry.readmit_all(who)
            controller = machine.active or self.registry.first_ready()
            if not controller:
                return False, f"{self.registry.why_not_ready(machine.target)}"
        machine.set_target(mode=wanted)
        if wanted is machine.mode:
            if machine.register.stopped:
                machine.stop_again(who)
            machine.renew()
            return True, f"{wanted} already"
        if wanted is not Mode.AUTO:
            self.drop(f"the mode has become {wanted}")
        machine.fire(
            OPERATOR_TRIGGERS[wanted],
            Reason(ReasonCode.REQUESTED, subject=str(wanted)),
            who,
            controller,
        )
        return True, f"{wanted} from the next command on" + (
            f", with {controller}" if controller else ""
        )

    def acknowledge(self, who: str) -> tuple[bool, str]:
        """Acknowledge the safe stop, so that it can be left; return success and the answer's text.

        Also accepts the values of sensors that have jumped. It is refused while a cause persists,
        or while a sensor that could show one is invalid; either voids it later, as does another
        safe stop. It is also refused until the actuator end reports the same safe stop: it may
        have one of its own that nobody has seen yet.
        """
        if self.machine.mode is not Mode.SAFE_STOP:
            return False, "there is no safe stop to acknowledge"
        if why_stop := self.safety.why_stop(acknowledged=True):
            message = f"{why_stop}"
            self.machine.log(Level.WARN, who, f"acknowledge: {message}")
            return False, message
        if self.machine.reported not in (None, self.machine.register.value):
            return False, "the machine has not confirmed the safe stop yet; ask again"
        self.safety.readmit(who)
        self.machine.acknowledge(who)
        return True, "acknowledged; now request a mode"

    def serve(self, now_s: float) -> None:
        """Make the requested swap, if possible; call it between two ticks."""
        self.expire(now_s)
        request, machine = self._pending, self.machine
        if request is None:
            return
        if machine.mode is not Mode.AUTO:
            self.drop(f"the mode has become {machine.mode}")
            return
        why_not = self._why_not(request.name)
        if why_not and (request.strict or request.done):
            self.drop(f"{why_not}")
        elif not why_not and request.name != machine.active:
            reason = Reason(ReasonCode.REQUESTED, subject=request.name)
            machine.swap(request.name, Cause.SWAP_REQUESTED, reason, request.who)
            self._swapped_ns = machine.time_ns

    def expire(self, now_s: float) -> None:
        """Time out an overdue request; a swap already made may still be answered in its tick."""
        request, settings = self._pending, self.machine.settings
        if request is None or request.done:
            return
        swapped = request.name == self.machine.active
        guard_s = (
            settings.lockstep_deadline_s
            if self.lockstep
            else settings.deadline_s
            if swapped
            else 0.0
        )
        late = self.lockstep and self.machine.elapsed(request.expires_ns, settings.tick_period_s)
        if late or now_s > request.expires_s + guard_s:
            why_not = (
                f"swapped, but {request.name} is not applied yet"
                if swapped
                else self._why_not(request.name)
            )
            self.drop(f"timed out: {why_not or 'no measurement has arrived for the swap'}")

    def on_applied(self, source: str) -> None:
        """Note the source of the sent command."""
        request = self._pending
        if request is not None and request.name == source:
            self._pending = None
            self._answer(request, True, f"{source} is applied")

    def failed(self, name: str, reason: str) -> None:
        """Note that ``name`` has failed while active."""
        if self._pending is not None and self._pending.name == name:
            self.drop(f"swapped, but {reason}")

    def drop(self, message: str) -> None:
        """Refuse the pending request, if any."""
        request, self._pending = self._pending, None
        if request is None:
            return
        if self.machine.target == request.name and self.machine.active:
            self.machine.set_target(self.machine.active)
        self._answer(request, False, message)

    def _why_not(self, name: str) -> str:
        """Why a swap to ``name`` is not possible now; empty if it is."""
        machine, why_not = self.machine, self.registry.why_not_ready(name)
        if (
            why_not
            or machine.mode is not Mode.AUTO
            or name == machine.active
            or self._swapped_ns is None
        ):
            return why_not
        recent = not machine.elapsed(self._swapped_ns, machine.settings.switch_interval_s)
        elapsed_s = (machine.time_ns - self._swapped_ns) / NANOSECONDS
        return f"the last swap was only {elapsed_s:.1f} s ago" if recent else ""

    def _answer(self, request: SwitchRequest, ok: bool, message: str) -> SwitchRequest:
        if not request.done or not ok:
            level = Level.INFO if ok else Level.WARN
            self.machine.log(level, request.who, f"switch to {request.name[:40]}: {message}")
        request.answer(ok, message)
        return request
