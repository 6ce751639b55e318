"""Which of two supervisors leads: the other stands by, follows it and takes over when it stops sending."""

from __future__ import annotations

from enum import StrEnum

from fsw_control.applied import SILENT_PERIODS
from fsw_control.command_check import refusal
from fsw_control.contract import Command, signature
from fsw_control.units import NANOSECONDS
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.state_machine import TOOK_OVER, Mode
from fsw_supervisor.tick import Decision, Tick

#: after a start: how long to listen for a leader [s]
LISTEN_S = 0.25
#: the same while another node publishes commands of which none has arrived yet [s]
_LISTEN_LONG_S = 1.0
#: leading, after a stall: how long commands are withheld in case there is another leader, in tick periods
_FENCE_TICKS = 1.0
#: on standby in lockstep: how long the leader may take to send what was decided here; it has the same inputs [s]
_LOCKSTEP_WAIT_S = 1.0
#: on standby, after a stall: how long the queues may take to drain, in tick periods
_DRAIN_TICKS = 0.3


class Role(StrEnum):
    """Role of this supervisor."""

    LISTENING = "listening"
    STANDBY = "standby"
    ACTIVE = "active"


class Failover:
    """Stands between the arbiter and the command topic.

    On standby the arbiter decides every tick, sends nothing and takes over what the leader has commanded. When
    ``takeover_ticks`` ticks in a row went unanswered, the decision on the last of them is sent. A leader that was
    stalled long enough for another one to take over withholds its commands for a tick, to learn what has happened
    meanwhile. Every failover begins a new term. Of two leaders the one with the greater term stays, so never the one
    that was stalled; in the same term (they started together) the one that has answered the newer tick, in a tie the
    one with the greater identity.

    ``identity`` differs from that of every other supervisor. With ``standby`` it begins as standby; otherwise it leads
    unless another one does.
    """

    def __init__(self, arbiter: Arbiter, identity: str, standby: bool, now_s: float) -> None:
        self.role = Role.STANDBY if standby else Role.LISTENING
        self.unanswered = 0  #: ticks in a row that nobody has answered, as seen on standby
        self.asserting = False  #: another supervisor leads, too, and must receive the state of this one
        self.rival_writer = False  #: other nodes publish commands, perhaps a leader whose commands have not arrived
        self._arbiter = arbiter
        self._identity = identity
        self._term = self._heard_term = 0
        self._started_s = self._called_s = now_s
        self._tick: Tick | None = None
        self._due_s = 0.0
        self._drained = False
        self._early: tuple[int, str, Command] | None = None
        self._last_ns = 0
        self._expected: Command | None = None
        self._fence_s: float | None = None
        self._held: list[Decision] = []
        self._unheard_ns: int | None = None  # leading: a safe stop of another leader since then may be unknown here
        arbiter.ticks.leading = False

    @property
    def token(self) -> str:
        """Term and identity: what this supervisor signs its commands and its state with."""
        return f"{self._term}.{self._identity}"

    @property
    def wakeup_s(self) -> float | None:
        """Steady time at which the arbiter's ``on_time`` must be called at the latest; None: nothing is waited for."""
        times = [time for time in (self._arbiter.wakeup_s, self._fence_s) if time is not None]
        if self.role is Role.LISTENING:
            times.append(self._listening_ends_s)
        waiting = self.role is not Role.ACTIVE and self._tick is not None and not self._tick.answered
        if waiting and self._due_s > self._called_s:
            times.append(self._due_s)
        return min(times, default=None)

    def leads(self, now_s: float) -> bool | None:
        """Whether this supervisor leads; None after a stall, until it is known whether another one has taken over."""
        if self.role is not Role.ACTIVE:
            return False
        return None if self._fence_s is not None or now_s - self._called_s > self._lease_s else True

    def pass_on(self, decisions: list[Decision], now_s: float) -> list[Decision]:
        """Return what may be published now; to be called with the decisions of every call of the arbiter."""
        gap_s, self._called_s = now_s - self._called_s, now_s
        if self.role is not Role.ACTIVE:
            if not self._takes_over(now_s):
                return []
            why = f"{TOOK_OVER}: {self.unanswered + 1} ticks went unanswered" if self.role is Role.STANDBY else ""
            self.role = Role.ACTIVE
            self._unheard_ns = None if self._arbiter.machine.mode is Mode.SAFE_STOP else self._last_ns
            self._term = max(self._term, self._heard_term) + 1
            decisions = self._arbiter.lead(why)
        elif gap_s > self._lease_s and self._fence_s is None:
            self._fence_s = now_s + _FENCE_TICKS * self._arbiter.settings.tick_period_s
        if self._fence_s is not None:
            self._held += decisions
            if now_s < self._fence_s:
                return []
            decisions = self._leave_fence()
        if decisions:
            self._last_ns = decisions[-1].stamp_ns
        self._expected = self._arbiter.applied
        return decisions

    def on_command(self, token: str, stamp_ns: int, source: str, command: Command) -> None:
        """Take a message seen on the command topic; ``token`` is that of its writer."""
        term, identity = signature(token)
        by_supervisor = identity not in ("", self._identity)
        if self.role is Role.ACTIVE and self._arbiter.on_command(stamp_ns, source, command, by_supervisor):
            return
        if not identity or refusal(command) is not None:
            return
        tick = self._arbiter.ticks.present
        age_ns = tick.stamp_ns - stamp_ns if tick is not None else -1
        if self.role is Role.ACTIVE:
            if 0 <= age_ns <= NANOSECONDS and self.on_leader_state(token, stamp_ns):
                self._follow(stamp_ns, source, command)
            return
        self._heard_term = max(self._heard_term, term)
        if age_ns < 0:
            # Its measurement has not come here yet.
            self._arbiter.on_source(source)
            self._early = (stamp_ns, source, command)
        elif age_ns <= NANOSECONDS:
            self._follow(stamp_ns, source, command)

    def on_leader_state(self, token: str, answered_ns: int, stopped_ns: int | None = None) -> bool:
        """Take the state of a supervisor that leads and has answered the tick ``answered_ns`` (0: none) last.

        ``stopped_ns``: the tick since which it is in a safe stop that nobody has acknowledged. That outlasts its lead:
        it may have been asked for while this supervisor, which stays, was taking over.

        Returns whether its state has to be followed.
        """
        term, identity = signature(token)
        if identity in (self._identity, ""):
            return False
        self._heard_term = max(self._heard_term, term)
        if self.role is Role.LISTENING:
            self.role = Role.STANDBY
        if self.role is Role.ACTIVE:
            if (term, answered_ns, identity) <= (self._term, self._last_ns, self._identity):
                self.asserting = True
                if stopped_ns is not None and self._unheard_ns is not None and stopped_ns >= self._unheard_ns:
                    self._unheard_ns = None  # once: the operator may acknowledge it before the other one falls silent
                    self._arbiter.keep_stop()
                return False
            self._step_down("another supervisor leads")
        return True

    # ---------------------------------------------------------------- standby

    @property
    def _listening_ends_s(self) -> float:
        return self._started_s + (_LISTEN_LONG_S if self.rival_writer else LISTEN_S)

    @property
    def _needed(self) -> int:
        # In lockstep there is no next tick before this one is answered.
        return 1 if self._arbiter.lockstep else self._arbiter.settings.takeover_ticks

    def _takes_over(self, now_s: float) -> bool:
        tick = self._arbiter.ticks.present
        if tick is not None and tick is not self._tick:
            self._count(tick)
        if self._arbiter.lockstep and tick is not None and not self._drained:
            decision = None if tick.outcome is None else tick.outcome.decision
            if decision is not None:
                self._due_s = min(self._due_s, tick.started_s + decision.latency_s + _LOCKSTEP_WAIT_S)
        if self.role is Role.LISTENING and now_s >= self._listening_ends_s:
            return True
        if tick is None or tick.answered or now_s < self._due_s or self.unanswered + 1 < self._needed:
            return False
        if now_s > self._due_s + self._arbiter.settings.stall_tolerance_s and not self._drained:
            # This process was stalled: the messages in the queues are handled first.
            self._drained = True
            self._due_s = now_s + _DRAIN_TICKS * self._arbiter.settings.tick_period_s
            return False
        return True

    def _count(self, tick: Tick) -> None:
        """Note that a tick has begun."""
        before, self._tick = self._tick, tick
        if before is not None and not before.answered and not before.stalled:
            self.unanswered += 1
        self._due_s = tick.started_s + self._arbiter.settings.takeover_s(self._arbiter.lockstep)
        self._drained = False
        if self._early is not None and self._early[0] <= tick.stamp_ns:
            early, self._early = self._early, None
            if early[0] == tick.stamp_ns:
                self._follow(*early)

    def _follow(self, stamp_ns: int, source: str, command: Command) -> None:
        if self.role is Role.LISTENING:
            self.role = Role.STANDBY
        self.unanswered = 0
        self._last_ns = stamp_ns
        self._arbiter.follow(stamp_ns, source, command)

    # ---------------------------------------------------------------- leader

    @property
    def _lease_s(self) -> float:
        """Another supervisor may have taken over after such a stall of this one."""
        settings = self._arbiter.settings
        if self._arbiter.lockstep:
            return settings.takeover_s(True) / 2.0
        return max(SILENT_PERIODS, self._needed - 0.5) * settings.tick_period_s

    def _leave_fence(self) -> list[Decision]:
        """Withheld commands; none if something else has moved the drives meanwhile."""
        self._fence_s = None
        held, self._held = self._held, []
        tick, expected = self._arbiter.ticks.present, self._expected
        if tick is None or tick.drives is None or expected is None or tick.stamp_ns <= self._last_ns:
            return held
        limits, acting = self._arbiter.settings.limits, self._arbiter.in_force.commanded(tick.drives)
        if (
            abs(acting.force_kn - expected.force_kn) <= limits.force_step_kn / 2.0
            and abs(acting.speed_rpm - expected.speed_rpm) <= limits.speed_step_rpm / 2.0
        ):
            return held
        # Starting again from where the drives are avoids a bump.
        self._arbiter.start_again(held)
        return []

    def _step_down(self, reason: str) -> None:
        self.role, self.asserting = Role.STANDBY, False
        self._fence_s, self.unanswered = None, 0
        held, self._held = self._held, []
        self._tick = self._arbiter.ticks.present
        self._arbiter.step_down(held, reason)
