"""Start of control after a start-up or a gap: bumpless, from the command in force."""

from __future__ import annotations

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.facts import Code, Fact
from fsw_supervisor.in_force import CommandInForce
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.state_machine import Level, Machine, Mode
from fsw_supervisor.tick import ProposalInput, Tick, check


class StartUp:
    """Determines the command in force and the active controller, and decides the mode ``start``.

    Before this supervisor's first command, a controller that reports itself as selected refers to
    the previous supervisor.
    """

    def __init__(
        self,
        machine: Machine,
        registry: ControllerRegistry,
        operator: OperatorRequests,
        in_force: CommandInForce,
    ) -> None:
        self.was_active = ""  #: controller that was active before; empty if unknown
        self.machine, self._registry, self._operator = machine, registry, operator
        self._in_force = in_force
        self._measured_s: float | None = None
        self._begun_tick = -2  #: last tick that began from a reported command

    @property
    def controller(self) -> str:
        """The controller to apply: the one active before, else the configured one."""
        return self.was_active or self.machine.target

    @property
    def listening_ends_s(self) -> float | None:
        """Steady time until which controllers may report their selection; None once irrelevant."""
        # On a busy machine nodes take a second to find each other, so the time is longer until the
        # first report.
        if not self._in_force.before_first or self._measured_s is None:
            return None
        settings = self.machine.settings
        wait_s = settings.takeover_wait_s
        if not self._registry.any_reported():
            wait_s = max(wait_s, settings.first_report_wait_s)
        return self._measured_s + wait_s

    def begin(self, now_s: float) -> None:
        """Note that measurements arrive; the listening time counts from the first one."""
        if self._measured_s is None:
            self._measured_s = now_s

    def interrupt(self) -> None:
        """At a gap in the measurements: forget the command in force, keep the controller."""
        # The actuator end may have ramped down meanwhile, so the command has to be found again.
        # The controller that was active knows the weld best and gets the first chance.
        self.was_active = self.machine.active or self.was_active
        if self._in_force.before_first:
            self._measured_s = None
        self._in_force.interrupt()

    def on_status(self, name: str, selected: bool) -> None:
        """Take a controller's report whether its command is applied."""
        if selected and self._in_force.before_first:
            self.was_active = name

    # ---------------------------------------------------------------- the command in force

    def find_command(self, tick: Tick, now_s: float, final: bool) -> Tick:
        """Determine the command in force, for a bumpless start, if it is known; return the tick.

        Sources in order of trust: the drives' feedback, the last command seen on the topic, the
        target controller's proposal, the operator's manual values.
        """
        machine, manual = self.machine, self._operator.manual
        candidate = tick.candidates.get(machine.target)
        # Feedback shows what acts, whatever happened before. The other sources only say what was
        # meant to act, and count once every controller has had time to report.
        if tick.drives is not None:
            acting = self._in_force.commanded(tick.drives)
            return self._begin_from(tick, acting, Code.FROM_DRIVES)
        if not final or not self._heard(now_s) or machine.reported is not None:
            return tick  # an actuator end that reports may have moved the drives itself
        if self._in_force.seen is not None:
            return self._begin_from(tick, self._in_force.seen, Code.FROM_COMMAND)
        if candidate is not None and not candidate.refusal:
            command = candidate.command
            return self._begin_from(tick, command, Code.FROM_PROPOSAL, controller=machine.target)
        if machine.mode is Mode.MANUAL and manual is not None:
            return self._begin_from(tick, manual, Code.FROM_OPERATOR)
        return tick

    def _begin_from(self, tick: Tick, command: Command, origin: Code, **data: str) -> Tick:
        applied = self.machine.settings.drive_limits.clip(command, None)
        self._in_force.begin_from(applied)
        # Proposals that arrived before were checked without a rate limit.
        tick = self._registry.check_again(tick._replace(previous=applied))
        if self.machine.tick - self._begun_tick > 1:  # else one message covers successive ticks
            values = {**applied._asdict(), "origin": Fact(origin, data)}
            self.machine.log(Level.INFO, "start", Code.TAKING_OVER, **values)
        self._begun_tick = self.machine.tick
        return tick

    def _listened(self, now_s: float) -> bool:
        """Whether the controllers have had time to report their selection."""
        ends_s = self.listening_ends_s
        return ends_s is None or now_s >= ends_s

    def _heard(self, now_s: float) -> bool:
        """Whether all controllers have reported, or have had time to."""
        return self._listened(now_s) or self._registry.all_reported()

    def may_command(self, tick: Tick, now_s: float, final: bool) -> bool:
        """Whether a first command may be sent in any mode, as a safe stop may have been in force.

        Only the controllers know. A status follows the proposal that it belongs to. While nobody
        has proposed, the tick is waited out: without measurements the listening time would pass
        in silence.
        """
        # A command other than the safe stop's would end a safe stop that the previous supervisor
        # had begun, without an acknowledgement.
        if not self._in_force.before_first or self.machine.mode is Mode.SAFE_STOP:
            return True
        if final:
            return self._heard(now_s)
        proposing = [record for record in self._registry if record.name in tick.candidates]
        reported = bool(proposing) and all(record.status_seen for record in proposing)
        return reported and self._listened(now_s)

    # ---------------------------------------------------------------- the mode start

    def decide(self, tick: Tick, final: bool) -> Reason:
        """Start with the previously active controller, else with the configured one.

        Returns why the tick's command is held instead; empty if the mode has changed, or nothing
        is decided yet.
        """
        machine, name = self.machine, self.controller
        if not final and name not in tick.candidates:
            return Reason()
        candidate = tick.candidates.get(name)
        why_not = Reason(ReasonCode.NO_PROPOSAL_YET)
        if candidate is not None:
            why_not = candidate.refusal or self._registry.blind(name)
        if not why_not:
            # The first good proposal within a move of the command in force ends the start.
            code = ReasonCode.ACTIVE_BEFORE if self.was_active else ReasonCode.CONFIGURED
            # after a gap the target is known, and is kept although a fallback was active
            if self._in_force.before_first:
                machine.set_target(name)
            self.was_active = ""
            machine.fire(Cause.READY, Reason(code, subject=name), "start", name)
            return Reason()
        if not tick.excuse:
            # In mid-weld the active controller gets some ticks: after a gap one sensor may come
            # back later than the others.
            if self.was_active and machine.ticks_in_mode > machine.settings.warm_ticks:
                self.was_active = ""
                machine.fire(Cause.ABANDONED, Reason(ReasonCode.ABANDONED, subject=name), "start")
                return Reason()
            if not self.was_active and (substitute := self._substitute(tick)):
                reason = Reason(ReasonCode.SUBSTITUTED, subject=name)
                machine.fire(Cause.READY, reason, "start", substitute)
                return Reason()
        machine.explain(Reason(ReasonCode.WAITING_FOR_CONTROLLER, subject=name, because=why_not))
        return machine.reason

    def correct_command(self, tick: Tick) -> Tick:
        """After a restart: separate the command in force from a disturbance of the feedback.

        The previously active controller proposes at most one move from the command in force. The
        plant itself only lowers the force and keeps the speed; if the drives report another speed
        or more force, it is a disturbance.
        """
        name, applied = self.was_active, self._in_force.applied
        candidate = tick.candidates.get(name)
        if not (self._in_force.before_first and candidate and candidate.jump and applied):
            return tick
        limits, proposed = self.machine.settings.drive_limits, candidate.command
        force_kn = applied.force_kn
        # Less force than proposed is the plant's own ramp and is kept; more is a disturbance, as
        # is any other speed.
        if force_kn - proposed.force_kn > limits.force_step_kn:
            force_kn = proposed.force_kn
        between = Command(force_kn, proposed.speed_rpm)
        tick = self._begin_from(tick, between, Code.FROM_BOTH, controller=name)
        again = ProposalInput(tick.stamp_ns, name, proposed)
        return tick.with_candidate(name, check(name, again, tick.previous, limits))

    def _substitute(self, tick: Tick) -> str:
        """Fallback with enough good proposals to replace an absent configured controller."""
        settings = self.machine.settings
        patience = max(settings.readmit_ticks, settings.warm_ticks)
        for name in settings.fallbacks:
            record = self._registry.get(name)
            if record is None or not self._registry.is_ready(name):
                continue
            # Counted without this tick, so that the arrival order of its messages does not matter.
            if record.consecutive_good - (name in tick.candidates) >= patience:
                return name
        return ""
