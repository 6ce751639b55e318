"""The arbiter: one command per tick, whatever happens.

Pure: no middleware, every time is handed in (steady seconds), every input is a method, and what has to be sent
comes back as a list of decisions. The modes and their transitions are the table in ``modes.py``.
"""

from __future__ import annotations

from collections import deque
from math import isclose, isfinite

from fsw_control.contract import SENSORS, Command
from fsw_control.validity import SensorGuard

from fsw_supervisor.checks import ProposalInput, Verdict, check
from fsw_supervisor.events import Event, EventLog, Level
from fsw_supervisor.interlocks import Interlocks, Severity
from fsw_supervisor.modes import OPERATOR_TRIGGERS, Mode, Trigger, next_mode
from fsw_supervisor.requests import SwitchRequest
from fsw_supervisor.roster import ControllerRecord, Roster
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.tick import NANOSECONDS, Decision, Stamps, Tick

#: name under which the drives' feedback of force and speed takes part in the making of ticks
DRIVES = "drives"
#: ticks that a proposal may lag behind in lockstep before its controller counts as silent
_LOCKSTEP_LAG = 20


class Arbiter:
    """Decides at every tick whose values are applied.

    Parameters
    ----------
    settings : ArbiterSettings
        Everything that can be set.
    lockstep : bool
        Whether the plant waits for the command, so that the wall clock only guards.
    guard : SensorGuard, optional
        Judge of the sensors.
    interlocks : Interlocks, optional
        Judge of the process.
    """

    def __init__(
        self,
        settings: ArbiterSettings,
        lockstep: bool = False,
        guard: SensorGuard | None = None,
        interlocks: Interlocks | None = None,
    ) -> None:
        self.settings = settings
        self.lockstep = lockstep
        self.guard = guard if guard is not None else SensorGuard()
        self.interlocks = interlocks if interlocks is not None else Interlocks()
        self.roster = Roster()
        self.events = EventLog()

        self.mode = Mode.START
        self.target_mode = Mode.AUTO
        self.active = ""
        self.target = settings.controller
        self.reason = "starting: waiting for measurements"
        self.requested_by = "start"
        self.since_ns = 0
        self.transitions = 0
        self.applied: Command | None = None
        self.last: Decision | None = None
        self.invalid_sensors: tuple[str, ...] = ()
        self.manual: Command | None = None
        self.ticks = 0
        self.commands = 0
        self.lost_ticks = 0
        self.stalls = 0
        self.foreign_commands = 0
        #: changes whenever something that an operator sees has changed
        self.revision = 0

        self._stamps = Stamps(silence_s=2.5 * settings.tick_period_s if not lockstep else 1.0)
        self._tick: Tick | None = None
        self._history: deque[tuple[int, Command | None]] = deque(maxlen=_LOCKSTEP_LAG)
        self._outbox: list[Decision] = []
        self._sent: deque[Decision] = deque(maxlen=50)
        self._drives: Command | None = None
        self._seen: Command | None = None
        self._started_s: float | None = None
        self._request: SwitchRequest | None = None
        self._swaps: deque[int] = deque(maxlen=100)
        self._operator_swap_index = -(10**9)
        self._slewing = 0
        self._mode_index = 0
        self._foreign_index = -(10**9)
        self._failure = ""
        self._now_s = 0.0

    # ---------------------------------------------------------------- inputs

    def on_sample(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[Decision]:
        """Take a sample of one of ``SENSORS`` (mm, N m, degC)."""
        self._note_stall(now_s)
        begun = self._stamps.offer(sensor, stamp_ns, value, now_s)
        if begun is not None:
            self._begin(stamp_ns, now_s)
            assert self._tick is not None
            self._tick.samples.update({name: v for name, v in begun.items() if name in SENSORS})
        elif self._tick is not None and stamp_ns == self._tick.stamp_ns and sensor in SENSORS:
            self._tick.samples.setdefault(sensor, value)
        self._advance(now_s)
        return self._take()

    def on_drives(self, stamp_ns: int, feedback: Command, now_s: float) -> list[Decision]:
        """Take the drives' feedback of what really acts on the process."""
        if isfinite(feedback.force_kn) and isfinite(feedback.speed_rpm):
            self._drives = feedback
        return self.on_sample(DRIVES, stamp_ns, feedback.force_kn, now_s)

    def on_proposal(self, name: str, proposal: ProposalInput, now_s: float) -> list[Decision]:
        """Take a proposal that came on the topic of controller ``name``."""
        self._note_stall(now_s)
        record = self.join(name)
        if record is not None:
            present = self._tick.stamp_ns if self._tick is not None else -1
            if proposal.stamp_ns > present:
                record.early = proposal
            elif proposal.stamp_ns == present:
                self._judge(record, proposal, now_s)
            else:
                self._judge_old(record, proposal)
        self._advance(now_s)
        return self._take()

    def on_status(self, name: str, tolerated_sensors: tuple[str, ...], selected: bool, now_s: float) -> list[Decision]:
        """Take what a controller declares of itself."""
        record = self.roster.get(name)
        if record is not None:
            record.tolerated_sensors = tuple(sensor for sensor in tolerated_sensors if sensor in SENSORS)
            record.says_selected = selected
            record.status_seen = True
        self._advance(now_s)
        return self._take()

    def on_time(self, now_s: float) -> list[Decision]:
        """Let time pass; to be called at ``wakeup_s`` at the latest."""
        self._note_stall(now_s)
        self._advance(now_s)
        self._expire(now_s)
        return self._take()

    def on_command(self, stamp_ns: int, source: str, command: Command) -> None:
        """Take a message seen on the command topic; anything not sent here is a foreign writer's."""
        for sent in self._sent:
            if sent.stamp_ns == stamp_ns and sent.source == source and _same(sent.command, command):
                return
        self.foreign_commands += 1
        if self.applied is None and isfinite(command.force_kn) and isfinite(command.speed_rpm):
            self._seen = command
        if self.ticks - self._foreign_index > 50:
            self._log(Level.ERROR, "foreign", f"a foreign writer commands: source {source[:40]!r}, {command}")
        self._foreign_index = self.ticks

    def join(self, name: str) -> ControllerRecord | None:
        """Note that controller ``name`` is in the graph; None when there are too many."""
        known = self.roster.get(name)
        if known is not None and known.present:
            return known
        record = self.roster.admit(name)
        if record is not None:
            record.present = True
            self._log(Level.INFO, name, f"controller {name} has joined")
        return record

    def leave(self, name: str) -> None:
        """Note that controller ``name`` is no longer in the graph."""
        record = self.roster.get(name)
        if record is not None and record.present:
            record.present = False
            self._log(Level.WARN, name, f"controller {name} has left the graph")

    # ---------------------------------------------------------------- the operator

    def request_switch(self, name: str, strict: bool, timeout_s: float, who: str, now_s: float) -> SwitchRequest:
        """Ask for controller ``name``; the answer is in the request returned, at once or later.

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
        timeout_s = timeout_s if isfinite(timeout_s) and timeout_s > 0.0 else 0.0
        index = self.ticks + self.settings.ticks(timeout_s)
        request = SwitchRequest(name, strict, now_s + timeout_s, index, who)
        record = self.roster.get(name)
        if record is None:
            known = ", ".join(item.name for item in self.roster.all()) or "none"
            request.answer(False, f"refused: unknown controller {name[:40]!r}; known: {known}")
            return self._answered(request)
        if self._request is not None:
            self._request.answer(False, f"superseded by a request for {name}")
            self._answered(self._request)
            self._request = None
        if self.mode is Mode.AUTO and name == self.active:
            self.target = name
            request.answer(True, f"{name} is active already")
            return self._answered(request)
        obstacle = self._switch_obstacle(name)
        if obstacle and (strict or timeout_s == 0.0):
            request.answer(False, f"refused: {obstacle}")
            return self._answered(request)
        self.target = name
        self.revision += 1
        if self.mode is not Mode.AUTO:
            request.answer(True, f"{name} is selected; the mode is {self.mode}: it is applied when auto begins")
            return self._answered(request)
        request.accepted = not obstacle
        self._request = request
        if timeout_s == 0.0:
            request.answer(True, f"accepted: {name} is applied from the next tick")
            self._answered(request)
        return request

    def request_mode(self, mode: str, manual: Command | None, who: str) -> tuple[bool, str]:
        """Ask for a mode (``auto``, ``manual``, ``hold``, ``safe_stop``); returns whether, and why in words."""
        try:
            wanted = Mode(mode)
            trigger = OPERATOR_TRIGGERS[wanted]
        except (ValueError, KeyError):
            return False, f"refused: unknown mode {mode[:40]!r}; known: {', '.join(OPERATOR_TRIGGERS)}"
        if wanted is Mode.MANUAL:
            verdict = check("manual", ProposalInput(0, "manual", manual or _NOTHING), None, self.settings.limits)
            if not verdict.ok:
                return False, f"refused: {verdict.reason}"
            self.manual = verdict.command
        if wanted is Mode.AUTO:
            refusal = self._enter_auto(who)
            if refusal:
                return False, f"refused: {refusal}"
        self.target_mode = wanted
        if wanted is self.mode:
            self.revision += 1
            return True, f"{wanted} already"
        self._fire(trigger, f"{who} asked for {wanted}", who)
        return True, f"{wanted} from the next command on"

    def _enter_auto(self, who: str) -> str:
        """Choose the controller that auto begins with; returns why there is none."""
        if self.mode is Mode.AUTO:
            self._readmit_all(who)
            return ""
        if self.interlocks.tripped:
            return f"interlock {', '.join(self.interlocks.tripped)} has tripped and is not clear"
        self._readmit_all(who)
        name = self._first_ready()
        if not name:
            return self.obstacle(self.target)
        self.active = name
        self._slewing = self.settings.transition_ticks
        return ""

    def _readmit_all(self, who: str) -> None:
        for record in self.roster.all():
            if record.latched_out:
                record.latched_out = ""
                self._log(Level.INFO, who, f"controller {record.name} is readmitted by {who}")

    # ---------------------------------------------------------------- what can be seen

    @property
    def wakeup_s(self) -> float | None:
        """Steady time at which ``on_time`` must be called at the latest; None: nothing is waited for."""
        tick = self._tick
        if tick is None or tick.decided:
            return None
        times = [tick.deadline_s, tick.started_s + self.settings.sensor_grace_s]
        if self.lockstep:
            times.append(tick.started_s + self.settings.lockstep_shadow_wait_s)
        if self.mode is Mode.START and self._started_s is not None:
            times.append(self._started_s + self.settings.takeover_wait_s)
        return min((time for time in times if time > self._now_s), default=tick.deadline_s)

    def obstacle(self, name: str) -> str:
        """Why controller ``name`` may not be selected now, in words; empty when it may."""
        record = self.roster.get(name)
        if record is None:
            return f"controller {name} is unknown"
        return record.obstacle(self.settings.warm_ticks, self.invalid_sensors, self.settings.duplicate_ticks)

    @property
    def foreign_writer(self) -> bool:
        """Whether someone else has written commands lately."""
        return self.ticks - self._foreign_index <= 50

    # ---------------------------------------------------------------- ticks

    def _begin(self, stamp_ns: int, now_s: float) -> None:
        self._now_s = now_s
        jumped = self._tick is not None and stamp_ns < self._tick.stamp_ns
        if self._tick is not None:
            if not self._tick.decided:
                self._tick.stalled = True
                self._decide(self._tick, final=True)
            self._close(self._tick)
        if jumped:
            self._forget_time()
        self.ticks += 1
        if self._started_s is None:
            self._started_s = now_s
        deadline_s = self.settings.lockstep_deadline_s if self.lockstep else self.settings.deadline_s
        self._tick = Tick(stamp_ns, self.ticks, now_s, now_s + deadline_s, self.applied)
        self._between_ticks(now_s)
        for record in self.roster.all():
            early, record.early = record.early, None
            if early is not None and early.stamp_ns == stamp_ns:
                self._judge(record, early, now_s)
            elif early is not None and early.stamp_ns > stamp_ns:
                record.early = early

    def _forget_time(self) -> None:
        """The clock went back: stamps seen before mean nothing any more."""
        self._log(Level.WARN, "clock", "time went back: counting on from there")
        self.guard.reset()
        self._history.clear()
        for record in self.roster.all():
            record.last_stamp_ns = -1
            record.early = None

    def _close(self, tick: Tick) -> None:
        """Close the books of a tick: who answered and who did not."""
        self._history.append((tick.stamp_ns, tick.before))
        for record in self.roster.all():
            if record.name in tick.verdicts:
                record.conflicts = record.conflicts + 1 if record.name in tick.conflicts else 0
                continue
            record.conflicts = 0
            record.silent_ticks += 1
            if tick.stalled or (self.lockstep and record.silent_ticks < _LOCKSTEP_LAG):
                continue
            if record.present:
                record.missed += 1
            if record.consecutive_good:
                self._log(Level.WARN, record.name, f"controller {record.name} has not proposed in time")
            if not record.problem or record.consecutive_good:
                record.bad("no proposal at the deadline")

    def _note_stall(self, now_s: float) -> None:
        """Notice that this process was held up itself: give the queues time to drain and blame nobody."""
        self._now_s = now_s
        tick = self._tick
        if tick is None or tick.decided or tick.stalled:
            return
        if now_s > tick.deadline_s + self.settings.stall_tolerance_s:
            tick.stalled = True
            tick.deadline_s = now_s + self.settings.stall_tolerance_s / 2.0
            self.stalls += 1
            self._log(Level.WARN, "arbiter", f"was held up for {now_s - tick.started_s:.3f} s")

    def _judge(self, record: ControllerRecord, proposal: ProposalInput, now_s: float) -> None:
        tick = self._tick
        assert tick is not None
        if record.last_stamp_ns == tick.stamp_ns:
            record.duplicates += 1
            earlier = tick.verdicts.get(record.name)
            if earlier is not None and not _same(earlier.command, proposal.command):
                tick.conflicts.add(record.name)
            return
        record.last_stamp_ns = tick.stamp_ns
        if tick.decided and tick.stalled:
            return
        latency_s = now_s - tick.started_s
        record.latency.add(latency_s)
        if now_s > tick.deadline_s and not self.lockstep:
            record.late += 1
            record.bad(f"late: {latency_s * 1e3:.0f} ms after the measurement")
            return
        verdict = check(record.name, proposal, tick.before, self.settings.limits)
        tick.verdicts[record.name] = verdict
        self._enter(record, verdict)

    def _judge_old(self, record: ControllerRecord, proposal: ProposalInput) -> None:
        """A proposal to a tick that is over: late, or repeated."""
        if proposal.stamp_ns <= record.last_stamp_ns:
            record.duplicates += 1
            record.rejected += 1
            return
        record.last_stamp_ns = proposal.stamp_ns
        before = dict(self._history)
        if self.lockstep and proposal.stamp_ns in before:
            self._enter(record, check(record.name, proposal, before[proposal.stamp_ns], self.settings.limits))
            return
        assert self._tick is not None
        record.late += 1
        if not self._tick.stalled:
            record.bad(f"late: answers a measurement {(self._tick.stamp_ns - proposal.stamp_ns) * 1e-6:.0f} ms old")

    def _enter(self, record: ControllerRecord, verdict: Verdict) -> None:
        """Enter a verdict in the controller's record."""
        if not verdict.ok:
            if verdict.content:
                record.rejected += 1
            if record.problem != verdict.reason and (record.consecutive_good or not record.problem):
                self._log(Level.WARN, record.name, f"proposal of {record.name} refused: {verdict.reason}")
            record.bad(verdict.reason)
            return
        record.good()
        if record.consecutive_good == self.settings.warm_ticks:
            self._log(Level.INFO, record.name, f"controller {record.name} is warm")
        if record.latched_out and 0 < self.settings.readmit_ticks <= record.consecutive_good:
            record.latched_out = ""
            self._log(Level.INFO, record.name, f"controller {record.name} is readmitted after good shadow ticks")

    # ---------------------------------------------------------------- between two ticks

    def _between_ticks(self, now_s: float) -> None:
        """The moment at which the active controller may change without a failure."""
        self._expire(now_s)
        held = self.ticks - self._mode_index
        if self.mode is Mode.HOLD and self.target_mode is Mode.AUTO:
            name = "" if self._storming() else self._first_ready()
            if name:
                self.active = name
                self._swaps.append(self.ticks)
                self._slewing = self.settings.transition_ticks
                self._fire(Trigger.CONTROLLER_BACK, f"{name} is ready again", "failover")
            elif held >= self.settings.ticks(self.settings.hold_timeout_s):
                text = f"held for {self.settings.hold_timeout_s:g} s: {self.reason}"
                self._fire(Trigger.HOLD_TIMEOUT, text, "failover")
        elif self.mode is Mode.AUTO and self._request is not None:
            self._serve(self._request)
        elif self.mode is Mode.AUTO and self.settings.return_to_target and self.active != self.target:
            self._return_to_target()

    def _return_to_target(self) -> None:
        if not self.obstacle(self.target) and not self._storming():
            self._swaps.append(self.ticks)
            self._swap(self.target, f"{self.target} is ready again", "failover")

    def _serve(self, request: SwitchRequest) -> None:
        obstacle = self._switch_obstacle(request.name)
        if not obstacle:
            request.accepted = True
            self._operator_swap_index = self.ticks
            self._swap(request.name, f"{request.who} asked for {request.name}", request.who)
        elif request.strict or request.done:
            self._give_up(request, f"refused: {obstacle}")

    def _switch_obstacle(self, name: str) -> str:
        obstacle = self.obstacle(name)
        elapsed = self.ticks - self._operator_swap_index
        if not obstacle and self.mode is Mode.AUTO and elapsed < self.settings.ticks(self.settings.switch_interval_s):
            return f"the last swap was only {elapsed} ticks ago"
        return obstacle

    def _expire(self, now_s: float) -> None:
        request = self._request
        if request is None or request.done:
            return
        guard_s = self.settings.lockstep_deadline_s if self.lockstep else 0.0
        in_ticks = self.lockstep and self.ticks > request.expires_index
        if in_ticks or now_s > request.expires_s + guard_s:
            why = self._switch_obstacle(request.name) or "no tick came to swap at"
            self._give_up(request, f"timed out: {why}")

    def _give_up(self, request: SwitchRequest, message: str) -> None:
        self._request = None
        if self.target == request.name and self.active:
            self.target = self.active
        request.answer(False, message)
        self._answered(request)

    def _answered(self, request: SwitchRequest) -> SwitchRequest:
        level = Level.INFO if request.ok else Level.WARN
        self._log(level, request.who, f"switch to {request.name[:40]}: {request.message}")
        return request

    def _first_ready(self) -> str:
        """First controller that may be selected: the target, then the fallback list; empty if none."""
        names = (self.target, *self.settings.fallbacks)
        return next((name for name in names if not self.obstacle(name)), "")

    def _storming(self) -> bool:
        window = self.settings.ticks(self.settings.storm_window_s)
        recent = sum(1 for index in self._swaps if self.ticks - index < window)
        return recent >= self.settings.storm_swaps > 0

    def _swap(self, name: str, reason: str, who: str) -> None:
        before, self.active = self.active, name
        self._slewing = self.settings.transition_ticks
        self._transition(reason, who, f"{before or 'nobody'} -> {name}")

    # ---------------------------------------------------------------- decisions

    def _advance(self, now_s: float) -> None:
        tick = self._tick
        if tick is None or tick.decided:
            return
        final = now_s >= tick.deadline_s
        if not final and not self._inputs_complete(tick, now_s):
            return
        self._decide(tick, final)

    def _inputs_complete(self, tick: Tick, now_s: float) -> bool:
        """Whether all is here that the decision shall not depend on the timing of."""
        if not tick.evaluated and now_s < tick.started_s + self.settings.sensor_grace_s:
            known_missing = {name for name, reason in self.guard.reasons.items() if reason == "missing"}
            if any(name not in tick.samples and name not in known_missing for name in SENSORS):
                return False
        if self.lockstep and now_s < tick.started_s + self.settings.lockstep_shadow_wait_s:
            for record in self.roster.all():
                keeps_up = record.silent_ticks == 0 and record.last_stamp_ns >= 0
                if record.name != self.active and keeps_up and record.name not in tick.verdicts:
                    return False
        return True

    def _decide(self, tick: Tick, final: bool) -> None:
        if not tick.evaluated:
            self._evaluate(tick)
        if self.applied is None and not self._take_over(tick):
            if final:
                tick.decided = True
                self.lost_ticks += 1
            return
        if self.mode is Mode.START:
            self._rule_start(tick, final)
        if self.mode is Mode.AUTO:
            self._rule_auto(tick, final)
        if tick.decided or self.mode in (Mode.START, Mode.AUTO):
            return
        assert self.applied is not None
        wanted = self.applied
        if self.mode is Mode.MANUAL and self.manual is not None:
            wanted = self.manual
        elif self.mode is Mode.SAFE_STOP:
            step = self.settings.safe_rate_kn_per_s * self.settings.tick_period_s
            safe = max(self.settings.safe_force_kn, self.applied.force_kn - step)
            wanted = Command(min(safe, self.applied.force_kn), self.applied.speed_rpm)
        self._commit(tick, wanted, str(self.mode), self.reason)

    def _evaluate(self, tick: Tick) -> None:
        """Judge the tick's sensors and the interlocks."""
        tick.evaluated = True
        measurement = self.guard.measure(tick.stamp_ns / NANOSECONDS, tick.samples)
        invalid = measurement.invalid_sensors()
        for name in invalid:
            if name not in self.invalid_sensors:
                self._log(Level.WARN, "sensors", f"sensor {name} is invalid: {self.guard.reasons[name]}")
        for name in self.invalid_sensors:
            if name not in invalid:
                self._log(Level.INFO, "sensors", f"sensor {name} is valid again")
        self.invalid_sensors = invalid
        values = {"depth_mm": measurement.depth_mm, "torque_nm": measurement.torque_nm}
        values["temperature_c"] = measurement.temperature_c
        acting = self._drives or self.applied
        if acting is not None:
            values["force_kn"] = acting.force_kn
            values["power_kw"] = measurement.torque_nm * acting.speed_rpm / _RPM_NM_PER_KW
        for change in self.interlocks.update(values):
            level = {Severity.OK: Level.INFO, Severity.WARN: Level.WARN, Severity.TRIP: Level.ERROR}[change.level]
            self._log(level, "interlock", change.text())
            if change.level is Severity.TRIP:
                self._fire(Trigger.INTERLOCK_TRIP, change.text(), "interlock")

    def _take_over(self, tick: Tick) -> bool:
        """Find out what is applied at present, so that the first command is no bump."""
        if self._drives is not None:
            found, origin = self._drives, "the drives' feedback"
        elif self._seen is not None:
            found, origin = self._seen, "a command seen on the topic"
        else:
            waited = self._started_s is not None and self._now_s - self._started_s >= self.settings.takeover_wait_s
            verdict = tick.verdicts.get(self.target)
            if not waited or verdict is None or not verdict.ok:
                return False
            found, origin = verdict.command, f"the proposal of {self.target}"
        self.applied = tick.before = self.settings.limits.clip(found, None)
        text = f"taking over at {self.applied.force_kn:.3f} kN, {self.applied.speed_rpm:.3f} rpm from {origin}"
        self._log(Level.INFO, "start", text)
        return True

    def _rule_start(self, tick: Tick, final: bool) -> None:
        """Begin with the controller that was active before a restart, else with the configured one."""
        selected = next((record.name for record in self.roster.all() if record.says_selected), "")
        name = selected or self.target
        complete = all(record.status_seen for record in self.roster.all() if record.present)
        waiting = self._started_s is not None and self._now_s - self._started_s < self.settings.takeover_wait_s
        verdict = tick.verdicts.get(name)
        if not final and (verdict is None or not complete or (waiting and not self.lockstep)):
            return
        if verdict is not None and verdict.ok and (self.lockstep or not waiting):
            self.active = self.target = name
            reason = f"{name} was active before" if selected else f"{name} is configured to start with"
            self._fire(Trigger.READY, reason, "start")
            return
        if selected and not waiting:
            self._fire(Trigger.RESUMED, f"{selected} was active before and does not propose", "start")
            return
        patience = max(self.settings.readmit_ticks, self.settings.warm_ticks)
        substitute = next((n for n in self.settings.fallbacks if not self.obstacle(n)), "")
        record = self.roster.get(substitute)
        if verdict is None and record is not None and record.consecutive_good > patience:
            self.active = substitute
            self._fire(Trigger.READY, f"{self.target} does not propose, {substitute} does", "start")
            return
        assert self.applied is not None
        self._commit(tick, self.applied, "hold", f"starting: waiting for {name}")

    def _rule_auto(self, tick: Tick, final: bool) -> None:
        """Apply the active controller's proposal, or the first fallback's in the same tick."""
        if not tick.failed:
            record = self.roster.get(self.active)
            verdict = tick.verdicts.get(self.active)
            blind = record.blind_to(self.invalid_sensors) if record is not None else "unknown"
            if record is not None and record.conflicts >= self.settings.duplicate_ticks:
                self._fail(tick, "two controllers of this name propose", latch=True)
            elif blind:
                self._fail(tick, blind, latch=False)
            elif verdict is None and not final:
                return
            elif verdict is None and tick.stalled:
                assert self.applied is not None
                self._commit(tick, self.applied, "hold", "the arbiter was held up")
                return
            elif verdict is None:
                self._fail(tick, "no proposal at the deadline", latch=True)
            elif not verdict.ok:
                self._fail(tick, verdict.reason, latch=True)
            else:
                self._follow(tick, verdict.command)
                return
        self._fall_back(tick, final)

    def _fail(self, tick: Tick, reason: str, latch: bool) -> None:
        tick.failed = True
        record = self.roster.get(self.active)
        self._failure = f"{self.active} failed: {reason}"
        if record is not None and latch:
            record.latched_out = reason
            record.bad(reason)
        self._log(Level.ERROR, "failover", self._failure)
        request = self._request
        if request is not None and request.accepted and request.name == self.active:
            self._request = None
            request.answer(False, f"swapped, but {self._failure}")
            self._answered(request)

    def _fall_back(self, tick: Tick, final: bool) -> None:
        if self._storming():
            self._fire(
                Trigger.STORM, f"too many swaps in {self.settings.storm_window_s:g} s: {self._failure}", "failover"
            )
            return
        for name in self.settings.fallbacks:
            if name == self.active or self.obstacle(name):
                continue
            verdict = tick.verdicts.get(name)
            if verdict is None and not final:
                return
            if verdict is not None and verdict.ok:
                self._swaps.append(self.ticks)
                self._swap(name, self._failure, "failover")
                self._follow(tick, verdict.command)
                return
        failure = f"{self._failure}; no fallback is ready"
        self._fire(Trigger.NO_CONTROLLER, failure, "failover")

    def _follow(self, tick: Tick, proposal: Command) -> None:
        """Apply a proposal; just after a swap within the transition limits."""
        before = tick.before
        assert before is not None
        command, reason = proposal, ""
        if self._slewing:
            force = _towards(before.force_kn, proposal.force_kn, self.settings.force_transition_kn)
            speed = _towards(before.speed_rpm, proposal.speed_rpm, self.settings.speed_transition_rpm)
            command = Command(force, speed)
            self._slewing = 0 if _same(command, proposal) else self._slewing - 1
            reason = "" if _same(command, proposal) else "slewing after a swap"
        self._commit(tick, command, self.active, reason)

    def _commit(self, tick: Tick, wanted: Command, source: str, reason: str) -> None:
        """Send the tick's one command, in limits and in rate whoever wants it."""
        command = self.settings.limits.clip(wanted, self.applied)
        tick.decided = True
        self.applied = command
        self.commands += 1
        decision = Decision(tick.stamp_ns, command, source, reason, max(0.0, self._now_s - tick.started_s))
        self.last = decision
        self._outbox.append(decision)
        self._sent.append(decision)
        request = self._request
        if request is not None and request.accepted and request.name == source:
            self._request = None
            if not request.done:
                request.answer(True, f"{source} is applied from {tick.stamp_ns / NANOSECONDS:.3f} s on")
                self._answered(request)

    def _take(self) -> list[Decision]:
        decisions, self._outbox = self._outbox, []
        return decisions

    # ---------------------------------------------------------------- transitions and log

    def _fire(self, trigger: Trigger, reason: str, who: str) -> bool:
        """Look the transition up in the table and make it; False when there is none."""
        target = next_mode(self.mode, trigger)
        if target is None:
            return False
        before, self.mode = self.mode, target
        self._mode_index = self.ticks
        if target is not Mode.AUTO:
            self._slewing = 0
            if self._request is not None:
                self._give_up(self._request, f"refused: the mode has become {target}")
            self.active = ""
        self._transition(reason, who, f"{before} -> {target}" + (f" ({self.active})" if target is Mode.AUTO else ""))
        return True

    def _transition(self, reason: str, who: str, text: str) -> None:
        self.reason, self.requested_by = reason, who
        self.since_ns = self._tick.stamp_ns if self._tick is not None else 0
        self.transitions += 1
        self._log(Level.ERROR if self.mode is Mode.SAFE_STOP else Level.INFO, who, f"{text}: {reason}")

    def _log(self, level: Level, who: str, text: str) -> None:
        self.revision += 1
        self.events.add(Event(self._tick.stamp_ns if self._tick is not None else 0, level, who, text))


_NOTHING = Command(float("nan"), float("nan"))
_RPM_NM_PER_KW = 30.0 / 3.141592653589793 * 1e3


def _same(one: Command, other: Command) -> bool:
    return isclose(one.force_kn, other.force_kn, rel_tol=1e-9) and isclose(one.speed_rpm, other.speed_rpm, rel_tol=1e-9)


def _towards(start: float, goal: float, step: float) -> float:
    return min(max(goal, start - step), start + step)
