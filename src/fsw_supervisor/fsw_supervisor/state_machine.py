"""The supervisor's state machine: modes, transitions as data, and what caused the present state.

A pair of mode and trigger that is not in ``TRANSITIONS`` has no effect;
``scripts/draw_state_machine.py`` draws the table. The stop register latches a safe stop
(``fsw_control/stop.py``): no transition leads out while it says stopped.
"""

from __future__ import annotations

from collections import deque
from enum import StrEnum
from typing import Any, NamedTuple

from fsw_control.cause import Cause
from fsw_control.coded import Worded
from fsw_control.contract import BUILT_IN_SOURCES, OPERATOR_MODES
from fsw_control.reason import Reason, ReasonCode
from fsw_control.stop import Stop, StopCause, StopRegister
from fsw_control.units import NANOSECONDS
from fsw_supervisor.facts import Code, Fact
from fsw_supervisor.parameters import SupervisorParameters


class Mode(StrEnum):
    """How the arbiter decides a tick."""

    START = "start"
    AUTO = "auto"
    MANUAL = "manual"
    HOLD = "hold"
    SAFE_STOP = "safe_stop"


#: modes that an operator can request, and their triggers
OPERATOR_TRIGGERS = {Mode(mode): Cause[f"OPERATOR_{mode.upper()}"] for mode in OPERATOR_MODES}


class Transition(NamedTuple):
    """Row of the table: ``trigger`` leads from ``source`` to ``target``; ``meaning``: when."""

    source: Mode
    trigger: Cause
    target: Mode
    meaning: str


def _to(target: Mode, trigger: Cause, meaning: str) -> list[Transition]:
    """Rows from every other mode to ``target``."""
    return [Transition(mode, trigger, target, meaning) for mode in Mode if mode is not target]


_FREE = "operator, after acknowledging a safe_stop"
_ABANDONED = "in mid-weld, the previously active controller sends nothing"
_BACK, _BLIND = "target auto, a controller is ready again", "a sensor is invalid for too long"

TRANSITIONS: tuple[Transition, ...] = (
    Transition(Mode.START, Cause.READY, Mode.AUTO, "first good proposal"),
    Transition(Mode.START, Cause.ABANDONED, Mode.HOLD, _ABANDONED),
    Transition(Mode.AUTO, Cause.INTERRUPTED, Mode.START, "measurements are back after a gap"),
    *_to(Mode.AUTO, Cause.OPERATOR_AUTO, f"{_FREE}, a controller is ready"),
    *_to(Mode.MANUAL, Cause.OPERATOR_MANUAL, f"{_FREE}, values in limits"),
    *_to(Mode.HOLD, Cause.OPERATOR_HOLD, _FREE),
    *_to(Mode.SAFE_STOP, Cause.OPERATOR_SAFE_STOP, "operator"),
    Transition(Mode.AUTO, Cause.NO_CONTROLLER, Mode.HOLD, "no usable controller left"),
    Transition(Mode.AUTO, Cause.STORM, Mode.HOLD, "too many automatic swaps"),
    Transition(Mode.HOLD, Cause.CONTROLLER_BACK, Mode.AUTO, _BACK),
    Transition(Mode.HOLD, Cause.HOLD_TIMEOUT, Mode.SAFE_STOP, "held too long"),
    Transition(Mode.START, Cause.START_TIMEOUT, Mode.SAFE_STOP, "no controller available"),
    Transition(Mode.MANUAL, Cause.BLIND_TIMEOUT, Mode.SAFE_STOP, _BLIND),
    *_to(Mode.SAFE_STOP, Cause.RESTARTED, "before its first command: a safe_stop was in force"),
    *_to(Mode.SAFE_STOP, Cause.STOP_HEARD, "another part of the weld holds a safe_stop"),
    *_to(Mode.SAFE_STOP, Cause.CLOCK_STOPPED, "stamps do not advance"),
    *_to(Mode.SAFE_STOP, Cause.INTERLOCK_TRIP, "an interlock is tripped"),
)

#: cause of a safe stop by its trigger; with ``STOP_HEARD`` the cause comes from elsewhere
STOP_CAUSES = {
    Cause.OPERATOR_SAFE_STOP: StopCause.OPERATOR,
    Cause.INTERLOCK_TRIP: StopCause.INTERLOCK,
    Cause.HOLD_TIMEOUT: StopCause.HOLD_TIMEOUT,
    Cause.START_TIMEOUT: StopCause.START_TIMEOUT,
    Cause.BLIND_TIMEOUT: StopCause.BLIND,
    Cause.RESTARTED: StopCause.RESTART,
    Cause.CLOCK_STOPPED: StopCause.CLOCK,
}

_TABLE = {(row.source, row.trigger): row.target for row in TRANSITIONS}


def next_mode(mode: Mode, trigger: Cause) -> Mode | None:
    """Mode that ``trigger`` leads to from ``mode``; None if the table has no such row."""
    return _TABLE.get((mode, trigger))


class Level(StrEnum):
    """Severity of an event."""

    INFO = "info"
    WARN = "warn"
    ERROR = "error"


class Event(NamedTuple):
    """A log entry; ``who`` is its origin: ``operator``, ``failover``, a controller ..."""

    level: Level
    who: str
    fact: Fact


class Standing(NamedTuple):
    """A mode and controller, their cause, why they last, and the requesting operator."""

    mode: str
    controller: str
    cause: Cause
    reason: Reason
    who: str = ""


class Machine:
    """State of the arbiter as seen by an operator; changes by the table and by swaps in auto only.

    ``mode`` and ``active`` are the actual mode and controller, ``target_mode`` and ``target`` the
    requested ones.
    """

    def __init__(self, settings: SupervisorParameters) -> None:
        self.settings = settings  #: may be replaced at any time
        self.mode = Mode.START
        self.target_mode = Mode.AUTO
        self.active = ""  #: controller whose proposals are applied; empty unless in auto
        self.target = settings.controller
        #: why the present state was entered or lasts
        self.reason = Reason(ReasonCode.NO_MEASUREMENT)
        self.cause = Cause.STARTED  #: trigger of the present state
        self.who = ""  #: operator who requested it
        self.since_ns = 0  #: stamp of the tick at which it was entered
        self.transitions = 0  #: changes of mode or controller since the start
        self.revision = 0  #: incremented at each change that an operator can see
        self.tick = 0  #: number of the present tick
        #: time of the present tick on the clock of all time-outs: the steady clock; in lockstep
        #: that of the stamps
        self.time_ns = 0
        self.mode_since_ns = 0  #: time on that clock at which the mode was entered
        #: time since the tick before, in whole tick periods, so that jitter does not accumulate
        self.step_s = 0.0
        self.slewing = 0  #: remaining ticks of the transition limits after a swap
        #: this supervisor's copy; while it says stopped, the mode is safe stop
        self.register = StopRegister()
        #: the actuator end's copy in its last report; None if there is no actuator end
        self.reported: Stop | None = None
        #: the latest events, removed when they are published
        self.events: deque[Event] = deque(maxlen=200)
        self._stamp_ns = 0
        self._mode_tick = 0
        self._automatic: deque[int] = deque(maxlen=100)  # times of automatic swaps
        self._origin_ns = self._periods = 0
        self._leader_standing: Standing | None = None  # as reported

    def advance(self, stamp_ns: int, time_ns: int | None = None) -> None:
        """Begin the next tick at ``time_ns`` on the time-outs' clock (default: a period later)."""
        self.tick += 1
        self._stamp_ns = stamp_ns
        period_ns = round(self.settings.tick_period_s * NANOSECONDS)
        time_ns = self.time_ns + period_ns if time_ns is None else time_ns
        # the time in a mode counts from the first measurement, which covers one period
        if self.tick == 1:
            self.mode_since_ns = self._origin_ns = time_ns - period_ns
        self.time_ns = max(time_ns, self.time_ns)
        # differences of rounded times since the origin, so that roundings do not add up
        before, self._periods = self._periods, round((self.time_ns - self._origin_ns) / period_ns)
        self.step_s = (self._periods - before) * self.settings.tick_period_s

    def pass_time(self, time_ns: int) -> None:
        """Let time pass without measurements."""
        self.time_ns = max(time_ns, self.time_ns)

    def elapsed(self, since_ns: int, limit_s: float) -> bool:
        """Whether ``limit_s`` has passed since a time, to the nearest tick because of jitter."""
        elapsed_s = (self.time_ns - since_ns) / NANOSECONDS
        return elapsed_s >= limit_s - self.settings.tick_period_s / 2.0

    @property
    def standing(self) -> Standing:
        """Mode and controller as reported: ``start`` appears as hold, since nothing changes."""
        mode = Mode.HOLD if self.mode is Mode.START else self.mode
        return Standing(str(mode), self.active, self.cause, self.reason, self.who)

    @property
    def ticks_in_mode(self) -> int:
        """Ticks since the mode was entered."""
        return self.tick - self._mode_tick

    def storming(self) -> bool:
        """Whether there were too many automatic swaps recently."""
        window_s = self.settings.storm_window_s
        recent = sum(not self.elapsed(time_ns, window_s) for time_ns in self._automatic)
        return recent >= self.settings.storm_swaps > 0

    def fire(self, trigger: Cause, reason: Reason, who: str, controller: str = "") -> None:
        """Make the transition for ``trigger``, if the table has one.

        ``controller`` becomes active if the transition leads to auto.
        """
        # The register is above the table: while it says stopped no trigger leads elsewhere,
        # whatever requests or controllers' returns were under way when the stop came.
        target = next_mode(self.mode, trigger)
        if target is None or (self.register.stopped and target is not Mode.SAFE_STOP):
            return
        before = self.mode
        known = trigger is Cause.RESTARTED and self.register.value.epoch > 0  # and acknowledged
        if target is Mode.SAFE_STOP and not self.register.stopped and not known:
            self.register.stop(STOP_CAUSES[trigger], who, self._stamp_ns)
        self._enter(target)
        self.active = controller if target is Mode.AUTO else ""
        self.slewing = self.settings.transition_ticks if target is Mode.AUTO else 0
        if trigger is Cause.CONTROLLER_BACK:
            self._automatic.append(self.time_ns)
        data = {"controller": controller} if self.active else {}
        code = Code.MODE_WITH if self.active else Code.MODE
        self._note(trigger, reason, who, code, before=before, mode=target, **data)

    def _enter(self, mode: Mode) -> None:
        """Enter a mode with the present tick."""
        self.mode, self._mode_tick, self.mode_since_ns = mode, self.tick, self.time_ns

    @property
    def acknowledged(self) -> bool:
        """Whether the present safe stop may be left."""
        return self.mode is Mode.SAFE_STOP and not self.register.stopped

    def renew(self, cause: StopCause = StopCause.OPERATOR, who: str = "operator") -> None:
        """Restart time-out and latch: the mode was requested again, or has a new cause."""
        if self.acknowledged:
            self.register.stop(cause, who, self._stamp_ns)
            self.revision += 1
        self._enter(self.mode)

    def stop_again(self, who: str) -> None:
        """Give a repeated safe stop a new epoch, as the old one may be acknowledged elsewhere."""
        self.register.stop(self.register.value.cause, who, self._stamp_ns)
        self.revision += 1

    def acknowledge(self, who: str) -> None:
        """Allow the present safe stop to be left when the operator requests another mode."""
        if self.register.stopped:
            self.register.acknowledge(who, self._stamp_ns)
            self.log(Level.INFO, who, Code.STOP_ACKNOWLEDGED, who=who)

    def merge_stop(self, stop: Stop) -> None:
        """Merge another copy of the stop register, which may begin a safe stop."""
        # It only grows, and merging takes the maximum (a state-based CRDT, Shapiro et al. 2011):
        # copies agree whatever was lost, repeated or reordered on the way. The one exception, a
        # stop that nobody else has heard, is in ``StopRegister.merge``.
        if self.register.merge(stop):
            self._take_register()

    def stop_for_plant(self, stamp_ns: int) -> None:
        """Begin a safe stop that the actuator end would have begun, had it not restarted."""
        self.register.stop(StopCause.WATCHDOG, "plant", stamp_ns)
        self._take_register()

    def _take_register(self) -> None:
        """Act on a register that has changed."""
        self.revision += 1
        if (stop := self.register.value).stopped:
            reason = Reason(ReasonCode.STOP_HEARD, subject=stop.cause.name.lower())
            self.fire(Cause.STOP_HEARD, reason, stop.who or "operator")

    def swap(self, name: str, cause: Cause, reason: Reason, who: str) -> None:
        """Make ``name`` the active controller; only in auto."""
        before, self.active = self.active, name
        self.slewing = self.settings.transition_ticks
        if cause is not Cause.SWAP_REQUESTED:
            self._automatic.append(self.time_ns)
        self._note(cause, reason, who, Code.SWAP, before=before, controller=name)

    def set_target(self, controller: str = "", mode: Mode | None = None) -> None:
        """Set the controller and the mode requested by the operator; omitted ones stay."""
        target = (controller or self.target, mode or self.target_mode)
        if target != (self.target, self.target_mode):
            self.target, self.target_mode = target
            self.revision += 1

    def slew(self, arrived: bool) -> None:
        """Count a tick under transition limits, which end at the new controller's values."""
        self.slewing = 0 if arrived else self.slewing - 1

    def mirror(self, source: str) -> None:
        """On standby: adopt the mode implied by the source of the leader's command."""
        # A command names its source: a mode of its own, else the active controller in auto. The
        # cause is in the leader's slower report, and taken only if that is of the same state.
        mode = Mode(source) if source in BUILT_IN_SOURCES else Mode.AUTO
        if self.register.stopped:
            mode = Mode.SAFE_STOP
        active = source if mode is Mode.AUTO else ""
        if (mode, active) != (self.mode, self.active):
            if mode is not self.mode:
                self._enter(mode)
            self.active = active
            self.cause, self.reason, self.who = Cause.UNKNOWN, Reason(), ""
        leader = self._leader_standing
        if leader is not None and (leader.mode, leader.controller) == (mode, active):
            self.cause, self.reason, self.who = leader.cause, leader.reason, leader.who

    def mirror_standing(self, standing: Standing) -> None:
        """On standby: note the state that the leader reports."""
        self._leader_standing = standing

    def lead(self, unanswered: int) -> None:
        """Take the lead, as ticks went unanswered, in the present state, whose cause is kept."""
        self.slewing = self.settings.transition_ticks
        self.transitions += 1
        self.log(Level.INFO, "takeover", Code.LEADS, mode=self.mode, ticks=unanswered)

    def explain(self, reason: Reason) -> None:
        """Set the reason why the present state lasts."""
        if reason != self.reason:
            self.reason = reason
            self.revision += 1

    def log(self, level: Level, who: str, code: Worded, /, **data: Any) -> None:
        """Record an event."""
        self.revision += 1
        self.events.append(Event(level, who, Fact(code, data)))

    def _note(self, cause: Cause, reason: Reason, who: str, code: Code, /, **data: Any) -> None:
        self.cause, self.reason, self.since_ns = cause, reason, self._stamp_ns
        heard = cause is Cause.STOP_HEARD and self.register.value.cause is StopCause.OPERATOR
        self.who = who if cause.on_request or heard else ""
        self.transitions += 1
        level = Level.ERROR if self.mode is Mode.SAFE_STOP else Level.INFO
        self.log(level, who, code, reason=reason, **data)
