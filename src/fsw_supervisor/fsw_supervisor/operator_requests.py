"""Operator requests for another controller or mode, and their answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, nan

from fsw_control.cause import Cause
from fsw_control.command_gate import refusal
from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_control.units import NANOSECONDS
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.facts import Answer, Code, Fact
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
    reply: Answer | None = None
    on_done: Callable[[], object] | None = None  #: called after the answer

    @property
    def done(self) -> bool:
        """Whether it is answered."""
        return self.reply is not None

    @property
    def ok(self) -> bool:
        """Whether it is served."""
        return self.reply is not None and self.reply.ok

    def answer(self, reply: Answer) -> None:
        """Answer the request; only the first answer counts."""
        if self.done:
            return
        self.reply = reply
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
            known = tuple(record.name for record in self.registry)
            reply = Answer.refused(Code.UNKNOWN_CONTROLLER, controller=name[:40], known=known)
            return self._answer(request, reply)
        self.drop(Fact.of(Code.SUPERSEDED, controller=name))
        if machine.mode is Mode.AUTO and name == machine.active:
            machine.set_target(name)
            return self._answer(request, Answer.done(Code.ACTIVE_ALREADY, controller=name))
        why_not = self._why_not(name)
        if why_not and (strict or timeout_s == 0.0):
            return self._answer(request, Answer(False, why_not))
        machine.set_target(name)
        if machine.mode is not Mode.AUTO:
            reply = Answer.done(Code.SELECTED, controller=name, mode=machine.mode)
            return self._answer(request, reply)
        self._pending = request
        if timeout_s == 0.0:
            self._answer(request, Answer.done(Code.ACCEPTED, controller=name))
        return request

    def ask_mode(self, mode: str, manual: Command | None, who: str) -> Answer:
        """Request one of ``OPERATOR_MODES`` (``manual`` with values)."""
        answer = self._ask_mode(mode, manual, who)
        if not answer.ok:
            data = {"mode": mode[:40], "answer": answer.fact}
            self.machine.log(Level.WARN, who, Code.MODE_REFUSED, **data)
        return answer

    def _ask_mode(self, mode: str, manual: Command | None, who: str) -> Answer:
        machine, controller = self.machine, ""
        if mode not in OPERATOR_TRIGGERS:
            known = tuple(OPERATOR_TRIGGERS)
            return Answer.refused(Code.UNKNOWN_MODE, mode=mode[:40], known=known)
        requested = Mode(mode)
        # A safe stop is never refused. Any other mode needs the cause gone and an acknowledgement:
        # two actions, so that no single slip of an operator raises the force again.
        if requested is not Mode.SAFE_STOP:
            if why_stop := self.safety.why_stop():
                return Answer(False, why_stop)
            if machine.mode is Mode.SAFE_STOP and not machine.acknowledged:
                return Answer.refused(Code.ACKNOWLEDGE_FIRST)
        if requested is Mode.MANUAL:
            manual = manual or Command(nan, nan)
            refused = refusal(manual, machine.settings.drive_limits)
            if refused is not None:
                return Answer.refused(Code.BAD_VALUES, refusal=refused)
            self.manual = manual
        if requested is Mode.AUTO:
            self.registry.readmit_all(who)
            controller = machine.active or self.registry.first_ready()
            if not controller:
                return Answer(False, self._not_ready(machine.target))
        machine.set_target(mode=requested)
        if requested is machine.mode:
            # a new epoch, so that no acknowledgement of the stop before covers this request
            if machine.register.stopped:
                machine.stop_again(who)
            machine.renew()
            return Answer.done(Code.MODE_ALREADY, mode=requested)
        if requested is not Mode.AUTO:
            self.drop(Fact.of(Code.MODE_CHANGED, mode=requested))
        reason = Reason(ReasonCode.REQUESTED, subject=str(requested))
        machine.fire(OPERATOR_TRIGGERS[requested], reason, who, controller)
        if controller:
            return Answer.done(Code.AUTO_NEXT, controller=controller)
        return Answer.done(Code.MODE_NEXT, mode=requested)

    def acknowledge(self, who: str) -> Answer:
        """Acknowledge the safe stop, so that it can be left.

        Also accepts the values of sensors that have jumped. It is refused while a cause persists,
        or while a sensor that could show one is invalid; either voids it later, as does another
        safe stop. It is also refused until the actuator end reports the same safe stop: it may
        have one of its own that nobody has seen yet.
        """
        if self.machine.mode is not Mode.SAFE_STOP:
            return Answer.refused(Code.NO_STOP)
        if why_not := self._why_not_acknowledged():
            self.machine.log(Level.WARN, who, Code.ACKNOWLEDGE_REFUSED, answer=why_not)
            return Answer(False, why_not)
        self.safety.readmit(who)
        self.machine.acknowledge(who)
        return Answer.done(Code.ACKNOWLEDGED)

    def _why_not_acknowledged(self) -> Fact | None:
        """Why a safe stop cannot be acknowledged now; None if it can be."""
        # The actuator end may have begun a stop of its own, which this would acknowledge unseen.
        unseen = self.machine.reported not in (None, self.machine.register.value)
        unconfirmed = Fact.of(Code.STOP_UNCONFIRMED) if unseen else None
        return self.safety.why_stop(acknowledged=True) or unconfirmed

    @property
    def acknowledgement_blocked_by(self) -> tuple[str, ...]:
        """Interlocks and sensors that refuse an acknowledgement now, else the answer's code."""
        # Only the supervisor knows which trips are consequences of the stop; a restart in
        # mid-stop loses that, and the same trip refuses from then on.
        stopped = self.machine.mode is Mode.SAFE_STOP
        why_not = self._why_not_acknowledged() if stopped else None
        causes = () if why_not is None else why_not.data.get("causes", (why_not,))
        return tuple(
            fact.data.get("interlock") or fact.data.get("sensor") or str(fact.code)
            for fact in causes
        )

    def serve(self, now_s: float) -> None:
        """Make the requested swap, if possible; call it between two ticks."""
        self.expire(now_s)
        request, machine = self._pending, self.machine
        if request is None:
            return
        if machine.mode is not Mode.AUTO:
            self.drop(Fact.of(Code.MODE_CHANGED, mode=machine.mode))
            return
        # Between two ticks only, so that every tick is decided under one controller. A controller
        # that is not ready yet keeps the request pending until it expires; a request that was
        # answered at once (time-out 0) has nobody who waits.
        why_not = self._why_not(request.name)
        if why_not and (request.strict or request.done):
            self.drop(why_not)
        elif not why_not and request.name != machine.active:
            reason = Reason(ReasonCode.REQUESTED, subject=request.name)
            machine.swap(request.name, Cause.SWAP_REQUESTED, reason, request.who)
            self._swapped_ns = machine.time_ns

    def expire(self, now_s: float) -> None:
        """Time out an overdue request; a swap already made may still be answered in its tick."""
        request, settings = self._pending, self.machine.settings
        if request is None or request.done:
            return
        # After the swap the tick under way may still apply it, hence the guard of one deadline. In
        # lockstep the time-out counts in stamps, and the wall clock is only a guard.
        swapped = request.name == self.machine.active
        guard_s = settings.deadline_s if swapped else 0.0
        if self.lockstep:
            guard_s = settings.lockstep_deadline_s
        late = self.lockstep and self.machine.elapsed(request.expires_ns, settings.tick_period_s)
        if late or now_s > request.expires_s + guard_s:
            why_not = Fact.of(Code.NOT_APPLIED, controller=request.name)
            if not swapped:
                why_not = self._why_not(request.name) or Fact.of(Code.NO_MEASUREMENT_YET)
            self.drop(Fact.of(Code.TIMED_OUT, reason=why_not))

    def on_applied(self, source: str) -> None:
        """Note the source of the sent command."""
        request = self._pending
        if request is not None and request.name == source:
            self._pending = None
            self._answer(request, Answer.done(Code.APPLIED, controller=source))

    def failed(self, name: str, reason: Reason) -> None:
        """Note that ``name`` has failed while active."""
        if self._pending is not None and self._pending.name == name:
            self.drop(Fact.of(Code.SWAP_FAILED, reason=reason))

    def drop(self, why: Fact) -> None:
        """Refuse the pending request, if any."""
        request, self._pending = self._pending, None
        if request is None:
            return
        if self.machine.target == request.name and self.machine.active:
            self.machine.set_target(self.machine.active)
        self._answer(request, Answer(False, why))

    def _not_ready(self, name: str) -> Fact:
        return Fact.of(Code.NOT_READY, controller=name, readiness=self.registry.readiness(name))

    def _why_not(self, name: str) -> Fact | None:
        """Why a swap to ``name`` is not possible now; None if it is."""
        machine = self.machine
        if not self.registry.is_ready(name):
            return self._not_ready(name)
        if machine.mode is not Mode.AUTO or name == machine.active or self._swapped_ns is None:
            return None
        recent = not machine.elapsed(self._swapped_ns, machine.settings.switch_interval_s)
        elapsed_s = (machine.time_ns - self._swapped_ns) / NANOSECONDS
        return Fact.of(Code.TOO_SOON, elapsed_s=elapsed_s) if recent else None

    def _answer(self, request: SwitchRequest, reply: Answer) -> SwitchRequest:
        if not request.done or not reply.ok:
            level = Level.INFO if reply.ok else Level.WARN
            data = {"controller": request.name[:40], "answer": reply.fact}
            self.machine.log(level, request.who, Code.SWITCH_ANSWERED, **data)
        request.answer(reply)
        return request
