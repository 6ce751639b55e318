"""The arbiter: one command per tick, under all conditions.

Pure: no middleware, times are arguments (steady seconds), every input is a method, and commands
are returned as a list of decisions. The modes and their transitions are the table in
``state_machine.py``.

Invariants:

- Each tick gets one command, or is counted as lost: before the first command, and in a gap.
- Each command is finite, within the limits and at most one move from the command in force; after a
  start or a gap, from the drives' actual values.
- While an interlock is tripped the mode is safe stop, from the tick in which it is judged:
  interlocks are level-triggered. Only the operator can leave a safe stop, with valid sensors and
  after an acknowledgement that no new cause has followed. A restart does not end it.
- No state without control lasts indefinitely: start, hold, and manual with an invalid sensor time
  out to safe stop.
- Each request is answered once, with a reason if it is refused.
"""

from __future__ import annotations

from collections.abc import Mapping

from fsw_control.cause import Cause
from fsw_control.command_gate import refusal
from fsw_control.contract import Command
from fsw_control.fence import LOST_COMMANDS, ActuatorState
from fsw_control.reason import Reason, ReasonCode
from fsw_control.stop import Stop
from fsw_supervisor.arbitration import Arbitration
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.facts import Code, Fact
from fsw_supervisor.in_force import CommandInForce, CommandWatch
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.parameters import SupervisorParameters, may_be_controller
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.start_up import StartUp
from fsw_supervisor.state_machine import OPERATOR_TRIGGERS, Level, Machine, Mode, Standing
from fsw_supervisor.tick import Decision, ProposalInput
from fsw_supervisor.ticks import Ticks


class Arbiter:
    """Takes all inputs of the supervisor on their steady time, and returns the commands to send.

    In lockstep the plant waits for the command, so the wall clock is only a guard.
    """

    def __init__(self, settings: SupervisorParameters, lockstep: bool = False) -> None:
        self.lockstep = lockstep
        self.machine = Machine(settings)  #: mode, active controller, target, reasons, events
        self.safety = SafetyMonitor(self.machine)  #: sensors and interlocks
        #: the controllers and their records
        self.registry = ControllerRegistry(self.machine, self.safety, lockstep)
        #: requests of the operator: ``ask_switch``, ``ask_mode``, ``acknowledge``
        self.operator = OperatorRequests(self.machine, self.registry, self.safety, lockstep)
        self.watch = CommandWatch()  #: distinguishes own commands from foreign ones
        self.in_force = CommandInForce()  #: the command that the drives follow
        # whether the actuator end knew a leader, and the source of the acting command
        self._knew: tuple[bool, bool] = (False, False)
        self._end_restarted = False  #: it has lost that knowledge
        self._start_up = StartUp(self.machine, self.registry, self.operator, self.in_force)
        parts = self.machine, self.registry, self.safety, self.operator, self.watch, self.in_force
        #: the present tick, and counts of the previous ones
        self.ticks = Ticks(Arbitration(*parts, self._start_up, lockstep))

    def configure(self, settings: SupervisorParameters) -> None:
        """Apply new settings, keeping the state."""
        self.machine.settings = settings
        self.safety.configure(settings)

    @property
    def settings(self) -> SupervisorParameters:
        """The settings at present."""
        return self.machine.settings

    @property
    def applied(self) -> Command | None:
        """Command in force; None until it is known."""
        return self.in_force.applied

    @property
    def wakeup_s(self) -> float | None:
        """Steady time at which ``on_time`` must be called at the latest; None if not needed."""
        return self.ticks.wakeup_s

    # ---------------------------------------------------------------- inputs

    def on_sample(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[Decision]:
        """Take a sample of one of ``SENSORS`` (mm, N m, degC)."""
        self.ticks.on_stamp(sensor, stamp_ns, value, now_s)
        return self.ticks.decide()

    def on_depth_deviation(self, stamp_ns: int, deviation_mm: float) -> None:
        """Take the standard deviation of a depth, ahead of its sample."""
        self.ticks.on_depth_deviation(stamp_ns, deviation_mm)

    def on_drives(self, stamp_ns: int, feedback: Command, now_s: float) -> list[Decision]:
        """Take the drives' feedback of actual force and speed."""
        if self._end_restarted and refusal(feedback) is None:
            self._compare(stamp_ns, feedback)
        repeated = self.in_force.on_drives(stamp_ns, feedback)
        self.ticks.on_stamp("drives", stamp_ns, feedback.force_kn, now_s)
        if repeated and self.lockstep:
            self.ticks.repeat(stamp_ns)
        return self.ticks.decide()

    def _compare(self, stamp_ns: int, feedback: Command) -> None:
        """Begin a safe stop if the drives are more than a move away from the last command.

        A restarted actuator end cannot know whether the machine has moved by itself meanwhile.
        """
        self._end_restarted, before = False, self.in_force.applied or self.in_force.seen
        acting = self.in_force.commanded(feedback)
        if before is not None and refusal(acting, self.settings.drive_limits, before) is not None:
            self.machine.stop_for_plant(stamp_ns)

    def on_proposal(self, name: str, proposal: ProposalInput, now_s: float) -> list[Decision]:
        """Take a proposal that arrived on the topic of controller ``name``."""
        self.ticks.pass_time(now_s)
        self.ticks.on_proposal(name, proposal)
        return self.ticks.decide()

    def on_status(
        self,
        name: str,
        tolerated_sensors: tuple[str, ...],
        selected: bool,
        now_s: float,
        applied_source: str = "",
    ) -> list[Decision]:
        """Take a controller's status, and the source of the applied command that it saw last."""
        self.ticks.pass_time(now_s)
        self.on_source(applied_source)
        if self.registry.on_status(name, tolerated_sensors):
            self._start_up.on_status(name, selected)
        return self.ticks.decide()

    def on_time(self, now_s: float) -> list[Decision]:
        """Process the passage of time; call it at ``wakeup_s`` at the latest."""
        self.ticks.pass_time(now_s)
        decisions = self.ticks.decide()
        self.operator.expire(now_s)
        self.ticks.note_silence()
        return decisions

    def on_command(
        self, stamp_ns: int, source: str, command: Command, by_supervisor: bool = False
    ) -> bool:
        """Take a message from the command topic; return whether this supervisor sent it.

        ``by_supervisor``: another supervisor has signed it.
        """
        if self.watch.is_own(stamp_ns, source, command, by_supervisor):
            return True
        self.in_force.on_foreign(command)
        self.on_source(source)
        if self.watch.note_foreign(self.ticks.now_s, self.machine.tick, by_supervisor):
            values = {**command._asdict(), "source": source[:40]}
            self.machine.log(Level.ERROR, "command topic", Code.FOREIGN_COMMAND, **values)
        return False

    def on_source(self, source: str) -> None:
        """Take the source of the command in force, as others report it: a safe stop is kept.

        Before the first command from here or from a leader, it can only stem from the supervisor
        before a restart.
        """
        if source == Mode.SAFE_STOP and self.ticks.last is None:
            self.machine.fire(Cause.RESTARTED, Reason(ReasonCode.STOPPED_BEFORE), "start")

    def on_actuator(self, state: ActuatorState) -> None:
        """Take the actuator end's report, the memory of what supervisors did before this one."""
        self.machine.reported = state.stop
        self.ticks.moved_itself = not state.source
        self.ticks.unheard = state.unanswered >= LOST_COMMANDS
        # The end remembers leader and command as long as it lives: if it knows less than before,
        # it was restarted. After a stop nothing has to be compared with its drives.
        knows = bool(state.leader), bool(state.source)
        self._end_restarted |= knows < self._knew and not state.stop.stopped
        self._knew = knows
        self.on_stop(state.stop)
        self.on_source(state.source)
        # This includes a controller whose topics have not been discovered yet: a restart waits
        # some ticks for it.
        self._start_up.on_status(state.source, may_be_controller(state.source))

    def on_stop(self, stop: Stop) -> None:
        """Merge another copy of the stop register; an acknowledgement readmits jumped sensors."""
        was_stopped = self.machine.register.stopped
        self.machine.merge_stop(stop)
        if was_stopped and not self.machine.register.stopped:
            self.safety.readmit(stop.who)

    # ---------------------------------------------------------------- leader and standby

    def follow(self, stamp_ns: int, source: str, command: Command) -> None:
        """On standby: adopt the leader's command."""
        applied = self.settings.drive_limits.clip(command, None)
        self.in_force.on_sent(applied)
        self.ticks.follow(Decision(stamp_ns, applied, source))
        if not self.safety.tripped:
            # With a cause of its own this supervisor stays in safe stop, even if the leader has
            # missed it.
            self.machine.mirror(source)

    def follow_operator(
        self,
        controller: str,
        mode: str,
        inhibited: Mapping[str, Reason],
        actual: Standing | None = None,
    ) -> None:
        """On standby: adopt the leader's targets and inhibited controllers, with their reasons.

        ``actual``: the leader's own state.
        """
        self.machine.set_target(controller, Mode(mode) if mode in OPERATOR_TRIGGERS else None)
        if actual is not None:
            self.machine.mirror_standing(actual)
        self.registry.mirror_inhibitions(inhibited)

    def lead(self, unanswered: int = 0) -> list[Decision]:
        """Send from now on, first the tick decided on standby; 0 ticks ``unanswered``: a start."""
        self.ticks.leading = True
        self.watch.change_role()
        if unanswered:
            self.machine.lead(unanswered)
        self.operator.manual = self.applied  # the manual mode continues with the command in force
        self._take_target()
        self.ticks.send()
        return self.ticks.decide()

    def _take_target(self) -> None:
        """Enter the mode requested of the previous leader, even if it sent no command since.

        A safe stop is left by a new request only: this one may be older than the stop.
        """
        target = self.machine.target_mode
        if self.machine.mode is not Mode.SAFE_STOP and target not in (Mode.AUTO, Mode.SAFE_STOP):
            reason = Reason(ReasonCode.REQUESTED_BEFORE, subject=str(target))
            self.machine.fire(OPERATOR_TRIGGERS[target], reason, "operator")

    def step_down(self) -> None:
        """Stop sending, including the last decision: another supervisor leads."""
        self.ticks.step_down()
        self.watch.change_role()
        # The last decision may not have been executed: the command in force comes from the leader
        # or the drives.
        self.in_force.forget()
        self.operator.drop(Fact.of(Code.OTHER_LEADS))
        self.machine.log(Level.WARN, "failover", Code.STANDBY)

    def withhold(self, decisions: list[Decision]) -> None:
        """Count decisions as lost that must not be sent before the actuator end's first report."""
        self.ticks.take_back(decisions)
        self.in_force.forget()
