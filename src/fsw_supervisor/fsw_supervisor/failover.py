"""Leader election and failover between supervisors, decided by the actuator end.

Terms as in Raft (Ongaro and Ousterhout 2014), but without votes: the actuator end is the single
arbiter, because every effective command passes it. Unanswered measurements are the heartbeat.
"""

from __future__ import annotations

from collections import deque
from enum import StrEnum

from fsw_control.applied import SILENT_PERIODS
from fsw_control.command_gate import refusal
from fsw_control.contract import Command
from fsw_control.fence import ActuatorState, Signature
from fsw_control.stop import Stop
from fsw_control.units import NANOSECONDS
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.state_machine import Machine
from fsw_supervisor.tick import Decision, Tick

#: listening time for a leader after a start [s]
LISTEN_S = 0.25
#: the same if another node publishes commands but none has arrived yet [s]
_LISTEN_LONG_S = 1.0
#: the same on standby, where a leader is expected [s] (chosen: longer than a process of
#: a graph lags behind another at the start)
_LISTEN_STANDBY_S = 5.0
#: a process that was not called for so long has not listened [s] (chosen: ten of its looks)
_DEAF_S = 2.0
#: in lockstep, on standby: silence after which a leader counts as dead [s] (chosen: it publishes
#: its state once a second, and a stalled recorder delays that by 0.5 s, ``DELIVERY_S``)
_SILENT_S = 2.0
#: on standby, after a stall: time for the queues to drain, in tick periods
_DRAIN_TICKS = 0.3
#: each takeover within this time doubles a standby's patience (exponential back-off), so that two
#: slow supervisors do not alternate [s] (chosen)
_RECENT_S = 30.0
#: largest factor of the patience: 2 ticks become 1.6 s, well before the plant's watchdog lowers
#: the force (chosen)
_LARGEST_FACTOR = 8


class Role(StrEnum):
    """Role of this supervisor."""

    LISTENING = "listening"
    STANDBY = "standby"
    ACTIVE = "active"


class Failover:
    """Stands between the arbiter and the command topic.

    The actuator end decides who leads (``fsw_control/fence.py``): it accepts commands of the
    greatest term only, and reports that term and its leader with every measurement. A supervisor
    sends nothing before it has received such a report; its term is above all reported ones. It
    steps down when the report names another leader of the same or a greater term. So commands of
    a leader that was stalled, cut off or replaced have no effect, whatever it believes.

    On standby the arbiter decides every tick, sends nothing and adopts the leader's commands. When
    ``takeover_ticks`` ticks in a row went unanswered, as counted by the actuator end, the decision
    on the present tick is sent under a new term. In lockstep an unanswered tick does not mean a
    dead leader: simulated time stands while any process is late. There the standby takes over from
    a leader of whom it hears nothing any more, neither commands nor its repeated state.

    Before the first report there are no ticks to count: the plant may wait for a publisher of
    commands. Then a standby that hears of no leader leads as after any other start.

    ``identity`` is unique among supervisors. With ``standby`` it starts as standby; otherwise it
    leads unless another supervisor does.
    """

    def __init__(self, arbiter: Arbiter, identity: str, standby: bool, now_s: float) -> None:
        self.role = Role.STANDBY if standby else Role.LISTENING
        self.term = 0  #: of this supervisor's present lead; 0 until it first sends
        #: last report of the actuator end; None before the first one
        self.actuator: ActuatorState | None = None
        #: another supervisor believes that it leads and must receive the state of this one
        self.asserting = False
        #: other nodes publish commands, perhaps a leader whose commands have not arrived
        self.rival_writer = False
        self._arbiter, self._identity = arbiter, identity
        self.heard_term = 0  #: greatest term heard of, in reports or from another leader
        self._listening_since_s = self._called_s = self._reported_s = now_s
        self._asserted_s = float("-inf")
        self.confirmed = False  #: the actuator end has reported the present lead
        self._tick = 0  # number of the last tick that this has seen begin
        self._leader_heard = False  #: since the last call
        self._early: tuple[int, str, Command] | None = None
        self._takeovers_s: deque[float] = deque(maxlen=8)
        arbiter.machine.reported = Stop()
        arbiter.ticks.leading = False
        self._await_leader(now_s)

    @property
    def signature(self) -> Signature:
        """Signature of this supervisor's commands."""
        return Signature(self.term, self._identity, self._arbiter.machine.register.value)

    @property
    def wakeup_s(self) -> float | None:
        """Steady time at which the arbiter's ``on_time`` must be called; None if not needed."""
        arbiter_s = self._arbiter.wakeup_s
        times = [] if arbiter_s is None else [arbiter_s]
        if self._listens:
            times.append(min(self._listening_ends_s, self._called_s + _DEAF_S / 2.0))
        tick = self._arbiter.ticks.present
        unanswered = tick is not None and not tick.answered
        if unanswered and self.role is not Role.ACTIVE and self._due_s > self._called_s:
            times.append(self._due_s)
        return min(times, default=None)

    @property
    def machine(self) -> Machine:
        """The arbiter's state."""
        return self._arbiter.machine

    def is_certain(self, now_s: float) -> bool:
        """Whether it is certain that this supervisor leads, or that it does not.

        After a stall, requests may be handled before the report of another's takeover.
        """
        if self.role is not Role.ACTIVE or self.actuator is None:
            return True
        # As with a lease (Gray and Cheriton 1989): others take over only after a silence that is
        # longer than this. A leader that has run or received a report since has not been silent.
        return now_s - self._reported_s <= self._lease_s or now_s - self._called_s <= self._lease_s

    @property
    def leads(self) -> bool:
        """Whether the actuator end accepts this supervisor's commands, by its last report."""
        confirmed = self.actuator is not None and self.actuator.leader == self._identity
        return self.role is Role.ACTIVE and confirmed and self.term > 0

    @property
    def last_decided_ns(self) -> int:
        """Stamp answered by the last command sent here or by the previous leader."""
        last = self._arbiter.ticks.last
        return 0 if last is None else last.stamp_ns

    @property
    def unanswered(self) -> int:
        """Number of ticks in a row before the present one that nobody has answered."""
        return 0 if self.actuator is None else self.actuator.unanswered

    def pass_on(self, decisions: list[Decision], now_s: float) -> list[Decision]:
        """Return what may be published; call it with the decisions of each call of the arbiter."""
        # After so long a start or pause, what has arrived meanwhile, and who is in the graph, is
        # not known yet. A shorter start may use up the listening time: then two may begin as
        # leaders, and neither sends before the actuator end's first report, which decides.
        if self._leader_heard or now_s - self._called_s > _DEAF_S:
            self._listening_since_s = now_s
        self._called_s = now_s
        if self._leader_heard and self._arbiter.lockstep:
            self._await_leader(now_s)
        self._leader_heard = False
        if self.role is not Role.ACTIVE:
            if not self._takes_over(now_s):
                return []
            unanswered = 0 if self._listens else self.unanswered + 1
            self.role, self.term, self.confirmed = Role.ACTIVE, 0, False
            decisions = self._arbiter.lead(unanswered)
        if decisions and self.actuator is None:
            self._arbiter.withhold(decisions)
            return []
        if decisions and self.actuator is not None:
            # A new term is taken with the first command, not with the role: a leader that never
            # sends does not depose anybody.
            self.term = self.term or max(self.actuator.term, self.heard_term) + 1
        return decisions

    # ---------------------------------------------------------------- inputs

    def on_actuator(self, state: ActuatorState, now_s: float) -> None:
        """Take the actuator end's report, before the measurement that it came with."""
        before, self.actuator, self._reported_s = self.actuator, state, now_s
        # Each takeover counts, by whomever: in a duel of two slow supervisors both become patient.
        if before is not None and before.leader and state.term > before.term:
            self._takeovers_s.append(now_s)
        self.heard_term = max(self.heard_term, state.term)
        self.confirmed |= state.leader == self._identity
        self._arbiter.on_actuator(state)
        is_led = state.leader and state.unanswered < self._needed(now_s)
        if self.role is Role.ACTIVE and self._is_other(state):
            self._step_down()
        elif self.role is Role.LISTENING and is_led:
            self.role = Role.STANDBY
        if self.role is not Role.ACTIVE and state.answered_ns > self.last_decided_ns:
            # The acting command was not received here: the drives show the command in force.
            self._arbiter.in_force.forget()

    def on_stop(self, stop: Stop) -> None:
        """Merge another part's copy of the stop register."""
        self._arbiter.on_stop(stop)

    def on_command(
        self, signature: Signature, stamp_ns: int, source: str, command: Command
    ) -> None:
        """Take a message seen on the command topic, with the signature of its writer."""
        term, leader, stop = signature
        by_supervisor = leader not in ("", self._identity)
        if by_supervisor:
            self.on_stop(stop)
        if self.role is Role.ACTIVE:
            self._arbiter.on_command(stamp_ns, source, command, by_supervisor)
            return
        if not leader or term < self.heard_term or refusal(command) is not None:
            return
        self.heard_term, self._leader_heard = term, True
        tick = self._arbiter.ticks.present
        age_ns = tick.stamp_ns - stamp_ns if tick is not None else -1
        if age_ns < 0:
            # Its measurement has not arrived here yet.
            self._arbiter.on_source(source)
            self._early = (stamp_ns, source, command)
        elif age_ns <= NANOSECONDS:
            self._follow(stamp_ns, source, command)

    def on_leader_state(self, signature: Signature) -> bool:
        """Take the state of another leading supervisor; return whether to follow it.

        Before the actuator end's first report the greater term wins, then the greater identity.
        """
        term, leader, stop = signature
        if leader in ("", self._identity):
            return False
        self.on_stop(stop)
        if self.role is Role.LISTENING:
            self.role = Role.STANDBY
        if self.role is Role.ACTIVE:
            loses = (term, leader) < (self.term, self._identity)
            # Of two that have sent under one term, the next report names the leader.
            if self.leads or loses or (self.term and term == self.term):
                # Rate-limited: two supervisors that both believe to lead would answer each other
                # for ever.
                if self._called_s - self._asserted_s >= self._arbiter.settings.tick_period_s:
                    self.asserting, self._asserted_s = True, self._called_s
                return False
            self._step_down()
        follows = self._leader_heard = term >= self.heard_term
        self.heard_term = max(self.heard_term, term)
        return follows

    # ---------------------------------------------------------------- standby

    @property
    def _listens(self) -> bool:
        """Whether it leads unless it hears of a leader in time, without counting ticks."""
        # A leader that is only slow has its publisher in the graph, so no time deposes it. Of two
        # that end listening together, reports and identities decide (``on_leader_state``).
        alone = self.actuator is None and not self.rival_writer
        return self.role is Role.LISTENING or (self.role is Role.STANDBY and alone)

    @property
    def _listening_ends_s(self) -> float:
        listen_s = _LISTEN_LONG_S if self.rival_writer else LISTEN_S
        if self.role is Role.STANDBY:
            listen_s = _LISTEN_STANDBY_S
        return self._listening_since_s + listen_s

    def _needed(self, now_s: float) -> int:
        """Ticks unanswered in a row, the present one included, that trigger a takeover."""
        if self._arbiter.lockstep:  # there is no next tick before this one has its answer
            return 1
        return self._arbiter.settings.takeover_ticks * self._patience(now_s)

    def _patience(self, now_s: float) -> int:
        """Exponential back-off: 1, 2, 4 or 8 times the shortest wait."""
        recent = sum(now_s - time_s < _RECENT_S for time_s in self._takeovers_s)
        return int(min(2**recent, _LARGEST_FACTOR))

    def _await_leader(self, from_s: float) -> None:
        """Give the leader time to answer; in lockstep, time to show that it is alive."""
        wait_s = self._arbiter.settings.takeover_s(False)
        if self._arbiter.lockstep:
            wait_s = _SILENT_S * self._patience(from_s)
        self._due_s, self._drained = from_s + wait_s, False

    def _takes_over(self, now_s: float) -> bool:
        tick = self._arbiter.ticks.present
        if tick is not None and self.machine.tick != self._tick:
            self._begin(tick)
            tick = self._arbiter.ticks.present  # the leader may have answered it already
        if self._listens:
            return now_s >= self._listening_ends_s
        if tick is None or now_s < self._due_s or self.actuator is None:
            return False
        # A leader whose commands arrive here but not at the actuator end does not lead.
        if self.unanswered + (not tick.answered) < self._needed(now_s):
            return False
        if self._arbiter.lockstep and not tick.settled:  # perhaps the leader cannot decide either
            return False
        if now_s > self._due_s + self._arbiter.settings.stall_tolerance_s and not self._drained:
            # This process was stalled: handle the queued messages first.
            if self._arbiter.lockstep:
                self._await_leader(now_s)
            else:
                self._due_s = now_s + _DRAIN_TICKS * self._arbiter.settings.tick_period_s
            self._drained = True
            return False
        return True

    def _begin(self, tick: Tick) -> None:
        """Note that a tick has begun."""
        self._tick = self.machine.tick
        if not (self._arbiter.lockstep and self.unanswered):  # the last tick was answered
            self._await_leader(tick.started_s)
        if self._early is not None and self._early[0] <= tick.stamp_ns:
            early, self._early = self._early, None
            if early[0] == tick.stamp_ns:
                self._follow(*early)
            # This supervisor missed a measurement that the leader has answered: the drives show
            # the command in force.
            else:
                self._arbiter.in_force.forget()

    def _follow(self, stamp_ns: int, source: str, command: Command) -> None:
        if self.role is Role.LISTENING:
            self.role = Role.STANDBY
        self._arbiter.follow(stamp_ns, source, command)

    # ---------------------------------------------------------------- leader

    @property
    def _lease_s(self) -> float:
        """Duration of a stall after which another supervisor may have taken over."""
        if self._arbiter.lockstep:
            return _SILENT_S / 2.0
        return SILENT_PERIODS * self._arbiter.settings.tick_period_s

    def _is_other(self, state: ActuatorState) -> bool:
        """Whether the actuator end follows another leader.

        A term of this supervisor that it has not seen yet may be ahead, but is not asserted
        against a leader that answers.
        """
        other, answers = state.leader not in ("", self._identity), state.unanswered == 0
        # it took over but has sent nothing yet, and the previous leader answers again
        if not self.term:
            return other and answers
        return other and (state.term >= self.term or (answers and not self.confirmed))

    def _step_down(self) -> None:
        self.role, self.term, self.asserting = Role.STANDBY, 0, False
        self._tick = self.machine.tick
        # Without measurements, two would give way to each other as fast as messages travel.
        self._await_leader(self._called_s)
        self._arbiter.step_down()
