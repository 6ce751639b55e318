"""Two supervisors, an actuator end, controllers and an operator's page on a network that loses, delays and repeats.

A world of pure cores, driven by events: no threads, no clock but its own, the same sequence of
letters gives the same events. The parts that do something are in ``pair_parts.py``, what must hold
is in ``pair_rules.py``.
"""

from __future__ import annotations

import heapq
from collections import deque
from typing import Any

from fsw_control import weld
from fsw_control.stop import Stop
from fsw_control.units import NANOSECONDS
from fsw_test_support.pair_rules import HEAL_S, PairRules

#: a message takes so long on a link that is well [s]
_FLIGHT_S = 0.001
#: by kind of a disturbed link, the delays of a message and of its copies, in turn; empty: it is
#: lost
LINKS: dict[str, tuple[tuple[float, ...], ...]] = {
    "cut": ((),),
    "lossy": ((_FLIGHT_S,), (), (_FLIGHT_S,), (_FLIGHT_S,), ()),
    "late": ((0.06,),),
    "slow": ((0.25,),),
    "dup": ((_FLIGHT_S, 0.13),),
    "swap": ((_FLIGHT_S,), (0.13,), (_FLIGHT_S,)),
}
#: a queue keeps as many messages of a kind as the topics do
_DEPTH = 10
#: nodes find a fresh one after this time [s]
_DISCOVERY_S = 0.1
#: from this temperature on there is a cause for a safe stop [degC]
TRIP_C = 910.0
#: more events than any disturbance makes
EVENTS_PER_S = 5000
#: in control: so many ticks in a row were answered by a controller's command
STEADY_TICKS = 10
SUPERVISORS = ("a", "b")
PARTS = (*SUPERVISORS, "end", "page", "controllers")


class Process:
    """A process: it may be suspended, die and begin again.

    What comes while it is suspended waits.
    """

    def __init__(self, name: str, world: World) -> None:
        self.name, self.world = name, world
        self.alive, self.frozen = True, False
        self.life = 0  #: how many have had this name; events of those before are void
        self.queue: deque[tuple[str, tuple[Any, ...], bool]] = deque()

    def begin(self) -> None:
        """Begin as a fresh process that knows nothing."""

    def greet(self, name: str) -> None:
        """Hand what is latched to a process that has begun."""

    def handle(self, method: str, args: tuple[Any, ...], is_timer: bool) -> bool:
        """Process an event; returns whether it has."""
        if not self.alive:
            return False
        if self.frozen:
            kinds = [item[0] for item in self.queue if item[0] == method]
            if len(kinds) >= (1 if is_timer else _DEPTH):
                for item in self.queue:
                    if item[0] == method:
                        self.queue.remove(item)
                        break
            self.queue.append((method, args, is_timer))
            return False
        getattr(self, method)(*args)
        return True

    def thaw(self, timers_first: bool) -> None:
        """Go on, with what has waited; its timers come before or after the messages."""
        self.frozen = False
        queue, self.queue = list(self.queue), deque()
        for item in sorted(queue, key=lambda item: item[2] is not timers_first):
            self.world.at(self.world.now_s, self, *item)


class World:
    """The parts, the events that are to come, and the letters.

    ``machine`` is of ``pair_ends.ENDS``.

    Attributes
    ----------
    transitions : int
        Events processed.
    links : dict
        Disturbed links, by sender and receiver.
    """

    def __init__(self, machine: str = "plant") -> None:
        from fsw_test_support.pair_ends import ENDS
        from fsw_test_support.pair_parts import Controllers, Page, Supervisor
        from fsw_test_support.pair_settings import SETTINGS

        self.now_s = 100.0
        self.clock_ns = 10**15  #: offset of the stamps' clock
        self.transitions = 0
        self.links: dict[tuple[str, str], str] = {}
        self.temperature_c = 885.0
        self.slowest_s = 0.0  #: time until control was back
        self.rules = PairRules(SETTINGS.drive_limits)
        self.answers: list[
            Any
        ] = []  #: requests of operators, in the order in which they were answered
        self._events: list[tuple[float, int, Process, int, str, tuple[Any, ...], bool]] = []
        self._serial = 0
        self._sent: dict[tuple[str, str], int] = {}
        self.end = ENDS[machine]("end", self)
        self.a, self.b = Supervisor("a", self), Supervisor("b", self, standby=True)
        self.page, self.controllers = Page("page", self), Controllers("controllers", self)
        self.parts: dict[str, Any] = {
            "a": self.a,
            "b": self.b,
            "end": self.end,
            "page": self.page,
            "controllers": self.controllers,
        }
        self.b.alive = False
        for name in ("end", "a", "page", "controllers"):
            self.parts[name].begin()
        self.tick(6)
        self._do_start("b")
        self.tick(6)

    @property
    def supervisors(self) -> tuple[Any, Any]:
        """Both supervisors."""
        return self.a, self.b

    # ---------------------------------------------------------------- events

    def at(
        self,
        due_s: float,
        process: Process,
        method: str,
        args: tuple[Any, ...] = (),
        is_timer: bool = False,
    ) -> None:
        """Let an event happen at a process as it is now.

        One that is begun meanwhile does not get it.
        """
        self._serial += 1
        heapq.heappush(
            self._events, (due_s, self._serial, process, process.life, method, args, is_timer)
        )

    def send(self, source: str, target: str, method: str, *args: Any) -> None:
        """Send a message over a link, which may be disturbed."""
        link, process = self.links.get((source, target)), self.parts[target]
        if link is None:
            self.at(self.now_s + _FLIGHT_S, process, method, args)
            return
        turn = self._sent[source, target] = self._sent.get((source, target), -1) + 1
        pattern = LINKS[link]
        for delay_s in pattern[turn % len(pattern)]:
            if delay_s > weld.TICK_S:
                self.rules.delayed(self.now_s)
            self.at(self.now_s + delay_s, process, method, args)

    def broadcast(self, source: str, targets: tuple[str, ...], method: str, *args: Any) -> None:
        """Send a message to several parts, but not to its sender."""
        for target in targets:
            if target != source:
                self.send(source, target, method, *args)

    def run(self, seconds: float) -> World:
        """Let time pass.

        Raises
        ------
        BrokenInvariantError
            When an invariant does not hold.
        """
        until_s, events, most = (
            self.now_s + seconds,
            self._events,
            self.transitions + round(EVENTS_PER_S * (seconds + 1)),
        )
        while events and events[0][0] <= until_s:
            due_s, _, process, life, method, args, is_timer = heapq.heappop(events)
            self.now_s = max(self.now_s, due_s)
            if life == process.life and process.handle(method, args, is_timer):
                self.transitions += 1
                if self.transitions > most:
                    self.rules.fail("I8", f"endless events: {method} of {process.name}")
                    raise RuntimeError("endless events")
                self.rules.look(self.end.fence, self.now_s)
        self.now_s = until_s
        self._watch()
        return self

    def tick(self, count: int = 1) -> World:
        """Let the time of some ticks pass, and watch between them."""
        for _ in range(count):
            self.run(weld.TICK_S)
        return self

    def _watch(self) -> None:
        """What is judged by levels.

        Which requests wait, and since when a leader can see a cause.
        """
        for supervisor in self.supervisors:
            if supervisor.alive and not supervisor.frozen:
                self.rules.waits(supervisor.requests, self.now_s)
        leader = next(
            (
                candidate
                for candidate in self.supervisors
                if candidate.alive and candidate.identity == self.rules.leader
            ),
            None,
        )
        runs = [self.end, self.controllers, *([leader] if leader is not None else [])]
        runs_all = leader is not None and all(item.alive and not item.frozen for item in runs)
        if not (runs_all and not self.links and self.end.is_well and self.temperature_c >= TRIP_C):
            self.rules.cause_s = None
        elif self.rules.cause_s is None:
            self.rules.cause_s = self.now_s

    # ---------------------------------------------------------------- letters

    def step(self, letter: str) -> World:
        """Do what a letter says; a letter that is not possible now does nothing."""
        verb, *words = letter.split()
        getattr(self, f"_do_{verb}")(*words)
        return self

    def _do_run(self, ticks: str) -> None:
        self.tick(int(ticks))

    def _do_ms(self, milliseconds: str) -> None:
        self.run(int(milliseconds) * 1e-3)

    def _do_link(self, kind: str, source: str, target: str) -> None:
        if kind == "well":
            self.links.pop((source, target), None)
        else:
            self.links[source, target] = kind

    def _do_isolate(self, name: str) -> None:
        for other in PARTS:
            if other != name:
                self.links[name, other] = self.links[other, name] = "cut"

    def _do_network(self, kind: str) -> None:
        self.links.clear()
        if kind != "well":
            self.links = {
                (source, target): kind for source in PARTS for target in PARTS if source != target
            }

    def _do_freeze(self, name: str) -> None:
        self.parts[name].frozen = self.parts[name].alive

    def _do_thaw(self, name: str, first: str = "timers") -> None:
        if self.parts[name].frozen:
            self._note_pause(name)
            self.parts[name].thaw(first == "timers")

    def _note_pause(self, name: str) -> None:
        part = self.parts[name]
        self.rules.delayed(self.now_s)
        for request in getattr(part, "requests", ()):
            request.ran_s = self.now_s

    def _do_kill(self, name: str) -> None:
        if self.parts[name].alive and self._copy_survives(name):
            self.kill(name)

    def kill(self, name: str) -> None:
        """Let a process die at once."""
        part = self.parts[name]
        part.alive = part.frozen = False
        part.life += 1
        part.queue.clear()
        self.rules.note_death()

    def _copy_survives(self, name: str) -> bool:
        """Whether the fault model allows a death.

        Another part that lives has the newest value of the register.
        """
        held = {
            item.name: item.register.value
            for item in self.parts.values()
            if item.alive and item.register
        }
        values = [value for holder, value in held.items() if holder != name]
        return max(values, default=None) == max(held.values()) if values else False

    def _do_start(self, name: str) -> None:
        part = self.parts[name]
        if part.alive or not self._is_reachable(name):
            return
        part.alive = True
        part.life += 1
        part.begin()
        self.rules.note_death()
        for other in self.parts.values():
            if name == "end" and self._is_holder_near(other):
                part.on_stop(other.register.value)  # it has listened before it begins
            if other.alive and other is not part:
                self.at(self.now_s + _DISCOVERY_S, other, "greet", (name,))

    def _is_reachable(self, name: str) -> bool:
        """Whether the fault model allows a start.

        A fresh actuator end hears the newest value of the register, and no supervisor lives that
        has missed it.
        """
        if name != "end":
            return True
        live = [item for item in self.parts.values() if item.alive and item.register]
        newest = max((item.register.value for item in live), default=Stop())
        if any(item.register.value < newest for item in self.supervisors if item.alive):
            return False
        return newest == Stop() or any(
            item.register.value == newest
            for item in self.parts.values()
            if self._is_holder_near(item)
        )

    def _is_holder_near(self, part: Any) -> bool:
        """Whether a part's copy of the register reaches the actuator end at once."""
        return (
            part.name != "end"
            and part.alive
            and part.register
            and (part.name, "end") not in self.links
            and not part.frozen
        )

    def _do_ask(self, kind: str, name: str) -> None:
        self.page.ask(kind, name)

    def _do_press(self) -> None:
        self.page.press()

    def _do_temperature(self, celsius: str) -> None:
        self.temperature_c = float(celsius)

    def _do_wish(self, force_kn: str) -> None:
        self.controllers.wish_kn = float(force_kn)

    def _do_clock(self, seconds: str) -> None:
        self.clock_ns += round(float(seconds) * NANOSECONDS)

    def _do_plc(self, state: str) -> None:
        self.end.set_plc(state)

    # ---------------------------------------------------------------- back to health

    def heal(self, heal_s: float = HEAL_S) -> World:
        """All is well from now on, and the operator wants auto.

        A controller must command within ``heal_s``.
        """
        self.links.clear()
        self.temperature_c = 885.0
        for state in ("well", "permits"):
            self._do_plc(state)
        for name in PARTS:
            self._do_thaw(name)
        self.tick(12)  # what was not heard is repeated once a second
        for name in ("end", "page", "controllers", *SUPERVISORS):
            self._do_start(name)
        until_s, answered = self.now_s + heal_s, 0
        while answered < STEADY_TICKS:
            if self.now_s > until_s:
                self.rules.fail("I7", self._state())
            leader = next(
                (item for item in self.supervisors if item.identity == self.rules.leader), None
            )
            before = self.rules.accepted
            if (
                leader is not None
                and self.rules.source in ("safe_stop", "hold", "manual")
                and not leader.requests
            ):
                stopped = self.end.register.stopped
                self.page.ask("acknowledge" if stopped else "auto", leader.name)
            self.tick()
            one_leads = [item.leads for item in self.supervisors].count(True) == 1
            steady = self.rules.accepted > before and self.rules.source not in (
                "safe_stop",
                "hold",
                "manual",
            )
            answered = answered + 1 if one_leads and steady else 0
        self.slowest_s = max(self.slowest_s, self.now_s - until_s + heal_s)
        return self

    def _state(self) -> str:
        """What each part is doing, in words."""
        members = [
            f"{item.identity}: {item.failover.role} in {item.arbiter.machine.mode}"
            for item in self.supervisors
        ]
        reasons = [item.arbiter.machine.reason.words for item in self.supervisors]
        seen = f"leader {self.rules.leader}, {self.rules.source}; {members}; {reasons}"
        return f"no control; {seen}; {self.end.register.value}"
