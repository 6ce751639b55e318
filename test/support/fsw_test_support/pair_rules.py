"""What must hold of a pair of supervisors, judged by what acts at the actuator end and by what operators are answered."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from fsw_control.command_gate import refusal
from fsw_control.contract import Command, Limits
from fsw_control.fence import Fence, Signature
from fsw_control.stop import Stop
from fsw_control.weld import TICK_NS
from fsw_supervisor.confirmation import CONFIRM_S

#: a cause has to last three ticks to count, and a tick takes 0.1 s; the rest is the way of
#: messages
CAUSE_S = 0.65
#: a switch waits for its controller before it is confirmed
SWITCH_S = 0.5
ANSWER_S = CONFIRM_S + 0.35
HEAL_S = 12.0
SWAPS, SWAPS_S = 9, 10.0
#: the invariants by their names, and under which faults they hold; the results page prints both
INVARIANTS = {
    "I1": "A safe stop that was answered with success stays: no other command acts before an "
    "acknowledgement was given later.",
    "I2": "Terms of commands that act never fall, and a term has one leader; the actuator's stop "
    "register never falls.",
    "I3": "While the actuator's register says stopped, or after its watchdog has reacted, "
    "only a safe stop acts, until an acknowledgement that was given later. "
    "If no gateway was there to see that its machine has moved by more than one move, "
    "only the leader before has to stop, and only if it is more than a move from where that "
    "leader has put it; a gateway takes less than 0.6 moves for rounding.",
    "I4": "A request answered with success has been in force at the actuator end since it was "
    "asked for.",
    "I5": "Of each stamp one command acts at most; it is inside the bounds, and one move at most "
    "from what acted before, or at one of the last three measurements. At the plant, one for each "
    "tick since the command before, but three at most, if that was lost or came after another "
    "leader's; six where commands are under way for longer than a tick.",
    "I6": "A cause that a supervisor in command can see and answer leads to a safe stop within "
    f"{CAUSE_S:g} s.",
    "I7": f"Once all is well, within {HEAL_S:g} s one supervisor leads, all ticks are answered, "
    "and, after the operator's acknowledgement, a controller commands. Two that live do not lead "
    f"in turns more than {SWAPS} times in {SWAPS_S:g} s.",
    "I8": "A request that has reached a running supervisor is answered within "
    f"{ANSWER_S:g} s, a switch {SWITCH_S:g} s later.",
}
FAULT_MODEL = (
    "any message may be lost, delayed, doubled or overtaken; any process may be suspended or die "
    "at any moment, several at once, as long as one part that lives holds the newest value of the "
    "stop register. The actuator end begins again only where that part reaches it while it "
    "listens, before it measures, and no supervisor lives that has missed that value. Clocks may "
    "step."
)
#: where single commands to the plant were lost, the next one is at most so many moves away
MOVES = 3
#: the same so long after a pause or a message that took longer than a tick: as many more may be on
#: their way
DELAYED_MOVES, DELAYED_S = 6, 0.6


class BrokenInvariantError(AssertionError):
    """An invariant does not hold; ``rule`` is its name."""

    def __init__(self, rule: str, words: str) -> None:
        super().__init__(f"{rule}: {words}")
        self.rule = rule


@dataclass(slots=True, eq=False)
class Request:
    """A request of an operator to a supervisor."""

    kind: str  #: ``safe_stop``, ``acknowledge``, ``hold``, ``manual``, ``auto`` or ``switch``
    asked_s: float
    taken_s: float | None = None  #: when a supervisor acted on it
    answered_s: float | None = None
    ok: bool | None = None  #: the answer
    shown: bool = False  #: its effect has been in force at the actuator end since it was acted on
    by: str = ""  #: the supervisor
    source: str = ""  #: of the commands that it asks for
    reached: bool = False  #: a supervisor has it
    ran_s: float = 0.0  #: when the supervisor that has it began to run with it


class PairRules:
    """Judges every event; raises BrokenInvariantError."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.most_moves = MOVES  #: of a command
        self.forgiven: frozenset[str] = (
            frozenset()
        )  #: invariants that are not checked, to see what else is broken
        self.open: list[Request] = []
        self.accepted = 0  #: commands that acted
        self.source = ""  #: of the last of them
        self.leader = ""
        self.last_s = 0.0  #: when it acted
        self.measured: deque[Command] = deque(maxlen=3)  #: what acted at the last measurements
        self._delayed_s = -1.0  #: when a command was under way for longer than a tick last
        self._late = 0  #: ticks by which the last command was late
        self._term = 0
        self._leaders: dict[int, str] = {}
        self._stop = Stop()
        self._stamps: deque[int] = deque(maxlen=64)
        self._acted_ns: int | None = None  #: stamp of the last command that acted
        self._stopped_s: float | None = None  #: of a safe stop that nobody has acknowledged
        self._acknowledged = Stop()  #: the greatest acknowledgement that was given
        self._in_stop_s = -1.0  #: when the actuator's register has said stopped last
        self._unseen_of = (
            ""  #: leader of the command before a reaction that no actuator end has seen
        )
        self._sent: dict[str, Command] = {}  #: the last command of each supervisor
        self._free_s = -1.0  #: when it has said last that there is none
        self._answered_stop: Request | None = None
        self._answered_stop_s = 0.0
        self._acknowledgements: deque[Request] = deque(maxlen=16)
        self._swaps: deque[float] = deque(maxlen=SWAPS + 1)
        self.cause_s: float | None = (
            None  #: since when a leader that runs can see a cause and answer it
        )

    # ---------------------------------------------------------------- the actuator end

    def begins(self) -> None:
        """A fresh actuator end: its terms and register begin again."""
        self._term, self._stop = 0, Stop()
        self._leaders.clear()
        self._stamps.clear()

    def note_death(self) -> None:
        """A supervisor has died or begun: leaders that change for that do not count as swaps."""
        self._swaps.clear()

    def look(self, fence: Fence, now_s: float) -> None:
        """Judge the actuator's register; after every event of the actuator end."""
        value = fence.register.value
        if value.stopped:
            self._in_stop_s = now_s
        else:
            self._free_s = now_s
        if value is self._stop:
            return
        if value < self._stop:
            self._broken("I2", f"the register falls from {self._stop} to {value}")
        self._stop = value
        if value.stopped and value > self._acknowledged:
            self._stopped_s = now_s if self._stopped_s is None else self._stopped_s
        for request in self.open:
            if (request.kind == "safe_stop" and value.stopped) or (
                request.kind == "acknowledge" and not value.stopped
            ):
                request.shown = True

    def sent(self, leader: str, command: Command) -> None:
        """A supervisor has sent a command."""
        self._sent[leader] = command

    def reacted(self, now_s: float, unseen: Command | None = None) -> None:
        """The watchdog has begun to lower the force.

        ``unseen``: where it is, while no actuator end was there.

        Then the leader before is the only one that can know what was in force: what it has sent,
        as far as it knows.
        """
        if unseen is None:
            self._stopped_s = now_s if self._stopped_s is None else self._stopped_s
        elif refusal(unseen, self._limits, self._sent[self.leader]) is not None:
            self._unseen_of = self.leader

    def acts(
        self,
        signature: Signature,
        stamp_ns: int,
        source: str,
        command: Command,
        before: Command,
        now_s: float,
        late: int = 0,
    ) -> None:
        """A command acts from now on.

        ``before`` acted until now, ``late``: ticks since its measurement.
        """
        self.accepted += 1
        if self._unseen_of == signature.leader and source != "safe_stop":
            self._broken(
                "I3", f"{source} of {signature.leader} acts after a reaction of the machine's own"
            )
        self._unseen_of = ""
        self._check_leader(signature, now_s)
        if stamp_ns in self._stamps:
            self._broken("I5", f"a second command of stamp {stamp_ns} acts")
        limits = self._within(stamp_ns, late, now_s)
        wrong = refusal(command, limits, before)
        self._stamps.append(stamp_ns)
        self._acted_ns = stamp_ns
        if wrong is not None and all(refusal(command, limits, acted) for acted in self.measured):
            self._broken("I5", f"{source} of {signature.leader}: {wrong.words}")
        if source != "safe_stop":
            self._check_control(source, signature, now_s)
        self.last_s = now_s

    def in_force(self, source: str) -> None:
        """The machine has taken a command."""
        self.source = source
        for request in self.open:
            request.shown |= self._asks_for(request, source)

    def delayed(self, now_s: float) -> None:
        """Commands are under way for longer than a tick.

        A process goes on after a pause, or a link is slow.
        """
        self._delayed_s = now_s

    def refused_as_second(self, signature: Signature) -> None:
        """A command was refused because another leader's acts for its measurement.

        It counts as lost.
        """
        if signature.leader != self.leader:
            self._late = max(self._late, MOVES - 1)

    def _within(self, stamp_ns: int, late: int, now_s: float) -> Limits:
        """The bounds, with one move for each tick since the command before.

        Single commands may have been lost.
        """
        ticks = 1 if self._acted_ns is None else round((stamp_ns - self._acted_ns) / TICK_NS)
        most = self.most_moves
        if most > 1 and now_s - self._delayed_s <= DELAYED_S:
            most = DELAYED_MOVES
        moves = min(max(ticks, 1 + late, 1 + self._late), most)
        self._late = late
        return replace(
            self._limits,
            force_step_kn=moves * self._limits.force_step_kn,
            speed_step_rpm=moves * self._limits.speed_step_rpm,
        )

    def _asks_for(self, request: Request, source: str) -> bool:
        if request.source == "controller":
            return source not in ("manual", "hold", "safe_stop")
        return request.source == source

    def _check_leader(self, signature: Signature, now_s: float) -> None:
        if signature.term < self._term:
            self._broken("I2", f"term {signature.term} acts after {self._term}")
        if self._leaders.setdefault(signature.term, signature.leader) != signature.leader:
            self._broken(
                "I2",
                f"term {signature.term} is of {self._leaders[signature.term]} and "
                f"{signature.leader}",
            )
        self._term = signature.term
        if signature.leader != self.leader:
            self.leader = signature.leader
            self._swaps.append(now_s)
            if len(self._swaps) > SWAPS and now_s - self._swaps[0] < SWAPS_S:
                self._broken(
                    "I7", f"{SWAPS} changes of the leader in {now_s - self._swaps[0]:.1f} s"
                )

    def _check_control(self, source: str, signature: Signature, now_s: float) -> None:
        if self._stopped_s is not None:
            since_s = now_s - self._stopped_s
            self._broken(
                "I3",
                f"{source} of {signature.leader} acts {since_s:.2f} s into a safe "
                "stop, unacknowledged",
            )
        stop = self._answered_stop
        if stop is not None and not self._acknowledged_since(stop):
            self._broken(
                "I1",
                f"{source} of {signature.leader} acts {now_s - self._answered_stop_s:.2f} "
                "s after a safe stop",
            )
        if self.cause_s is not None and now_s - self.cause_s > CAUSE_S:
            self._broken(
                "I6",
                f"{source} acts {now_s - self.cause_s:.2f} s after a cause has become visible",
            )

    def _acknowledged_since(self, stop: Request) -> bool:
        """Whether an acknowledgement was acted on after a stop was asked for.

        The same supervisor must not answer it before the stop.
        """
        return any(
            (item.taken_s or 0.0) >= stop.asked_s
            and (
                item.by != stop.by
                or item.answered_s is None
                or item.answered_s >= self._answered_stop_s
            )
            for item in self._acknowledgements
        )

    # ---------------------------------------------------------------- operators

    def taken(
        self, request: Request, source: str, value: Stop, fence: Fence | None, now_s: float
    ) -> None:
        """A supervisor has acted on a request, without refusing it.

        ``value``: its copy of the register after that.
        """
        request.taken_s, request.source = now_s, source
        self.open.append(request)
        if request.kind == "acknowledge":
            self._acknowledgements.append(request)
            self._acknowledged = max(self._acknowledged, value)
            if value > self._stop:
                self._stopped_s, self._unseen_of = None, ""
        if fence is not None and request.kind == "safe_stop":
            request.shown = fence.register.stopped or self._in_stop_s >= request.asked_s
        elif fence is not None and request.kind == "acknowledge":
            request.shown = not fence.register.stopped or self._free_s >= request.asked_s
        elif source:
            request.shown = self._asks_for(request, self.source)

    def answered(self, request: Request, ok: bool, now_s: float) -> None:
        """A supervisor has answered a request."""
        request.ok, request.answered_s = ok, now_s
        if request in self.open:
            self.open.remove(request)
        if ok and not request.shown:
            self._broken(
                "I4",
                f"{request.kind} was answered with success {now_s - request.asked_s:.2f} s "
                "after it was asked",
            )
        if ok and request.kind == "safe_stop":
            self._answered_stop, self._answered_stop_s = request, now_s

    def waits(self, requests: list[Request], now_s: float) -> None:
        """Judge the requests that a running supervisor has not answered."""
        for request in requests:
            limit_s = ANSWER_S + SWITCH_S * (request.kind == "switch")
            if request.answered_s is None and now_s - request.ran_s > limit_s:
                self._broken("I8", f"{request.kind} waits for {now_s - request.ran_s:.2f} s")

    def _broken(self, rule: str, words: str) -> None:
        if rule not in self.forgiven:
            raise BrokenInvariantError(rule, words)

    def fail(self, rule: str, words: str) -> None:
        """Report what the world has found itself."""
        self._broken(rule, words)
