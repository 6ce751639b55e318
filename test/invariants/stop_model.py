#!/usr/bin/env python3
"""Exhaustive search of the stop register with the fence, two supervisors and a page, within bounds.

usage: stop_model.py [--epochs E] [--terms T] [--restarts R] [--requests S] [--delayed M]

Any message may be lost, repeated, delayed and overtaken without limit. All copies of the register
stay under way. Of reports and of commands, those that the parts send in their present state can be
delivered, and ``delayed`` of those sent before, whichever these are: the bound is on how many are
late at once, not on how late.

The parts are the real classes (``fsw_test_support/stop_parts.py``). Supervisors take over, the
actuator end reacts by itself and operators ask at any time, so that counts of measurements, times
and stamps need no state. The page is any value that it may have heard; thus it restarts at any
time. From every state the parts must also recover.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Hashable, Iterator
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

if __name__ == "__main__":
    sys.path.append(str(Path(__file__).resolve().parents[2] / "scripts"))
    from _bootstrap import ensure

    ensure(dev=True, extras=["machine"])

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from fsw_control.fence import ActuatorState
from fsw_control.stop import Stop
from fsw_test_support import stop_parts as parts
from fsw_test_support.stop_parts import CONTROL, End, Message, Supervisor

#: rounds of messages after which control must be back, when all are delivered and the operator
#: acknowledges
HEAL_ROUNDS = 8


class Bounds(NamedTuple):
    """How far the search goes."""

    epochs: int = 3  #: greatest epoch of the register
    terms: int = 2  #: greatest term
    restarts: int = 0  #: of supervisors and actuator end, in all; the page restarts at any time
    requests: int = 1  #: for a safe stop, to a supervisor
    delayed: int = (
        1  #: reports under way that the actuator end would not send now; commands likewise
    )


#: of the short tests: seconds each
SHORT = (
    Bounds(epochs=3, requests=0, delayed=0),
    Bounds(epochs=2, delayed=0),
    Bounds(epochs=2, terms=1),
    Bounds(epochs=2, restarts=1, requests=0, delayed=0),
    Bounds(epochs=1, restarts=1, requests=0),
    Bounds(epochs=1, requests=0, delayed=2),
)


class State(NamedTuple):
    """A state: numbers of the parts' values, and bits of late messages, in the order in which the search met them."""

    end: int
    a: int
    b: int
    reports: int = 0
    commands: int = 0
    copies: int = 0
    restarts: int = 0
    requests: int = 0
    life: int = 0  #: of the actuator end; a new one does not get the commands to the one before
    ramps: bool = False  #: the actuator end moves the drives by itself
    #: a safe stop was answered with success, and not acknowledged since it was asked for
    stopped: bool = False
    reacted: bool = False  #: the actuator end has reacted, and nobody has acknowledged since


class BrokenError(AssertionError):
    """An invariant does not hold."""


def _choices(bits: int, most: int) -> list[int]:
    """Which ``most`` of the messages may be under way; with fewer nothing else is possible."""
    if bits.bit_count() <= most:
        return [bits]
    single = [1 << number for number in range(bits.bit_length()) if bits >> number & 1]
    return [sum(chosen) for chosen in combinations(single, most)]


class Numbers:
    """Numbers for the values of a kind."""

    def __init__(self) -> None:
        self.items: list[Any] = []
        self._numbers: dict[Hashable, int] = {}

    def number(self, item: Hashable) -> int:
        """The number of a value."""
        number = self._numbers.get(item)
        if number is None:
            number = self._numbers[item] = len(self.items)
            self.items.append(item)
        return number

    def bit(self, item: Hashable) -> int:
        """The bit of a message."""
        return 1 << self.number(item)

    def of(self, bits: int) -> Iterator[Any]:
        """The messages of some bits."""
        while bits:
            lowest = bits & -bits
            yield self.items[lowest.bit_length() - 1]
            bits ^= lowest


class Model:
    """The transitions between states, with the invariants.

    What the real classes return is computed once per value.
    """

    def __init__(self, bounds: Bounds) -> None:
        self.bounds = bounds
        self.ends, self.supervisors = Numbers(), Numbers()
        self.reports, self.commands, self.copies = Numbers(), Numbers(), Numbers()
        self._known: dict[Any, Any] = {}

    def begin(self) -> State:
        """A supervisor leads and a controller commands; the other one has followed."""
        leader = Supervisor("a0", True, 1, True, 1, confirmed=True, fresh=False)
        standby = Supervisor("b0", reported=True, heard_term=1, fresh=False)
        end = End(term=1, leader="a0", source=CONTROL)
        return State(
            self.ends.number(end),
            self.supervisors.number(leader),
            self.supervisors.number(standby),
        )

    def _once(self, function: Callable[..., Any], *args: Hashable) -> Any:
        key = (function, args)
        if key not in self._known:
            self._known[key] = function(*args)
        return self._known[key]

    # ---------------------------------------------------------------- transitions

    def moves(self, state: State) -> Iterator[tuple[str, State]]:
        """Every state that may follow, with what has happened."""
        sent = self._once(self._present, state.end, state.a, state.b)
        reports, commands = state.reports | sent[0], state.commands | sent[1]
        for words, after in self._parts(state, reports, commands):
            present = self._once(self._present, after.end, after.a, after.b)
            late_reports, copies = reports & ~present[0], after.copies | present[2]
            late_commands = commands & ~present[1] if after.life == state.life else 0
            for left_reports in self._once(_choices, late_reports, self.bounds.delayed):
                for left_commands in self._once(_choices, late_commands, self.bounds.delayed):
                    yield (
                        words,
                        after._replace(
                            reports=left_reports, commands=left_commands, copies=copies
                        ),
                    )

    def _present(self, end: int, a: int, b: int) -> tuple[int, int, int]:
        """What the parts send in their present state."""
        commands = copies = 0
        for value in (
            self.ends.items[end].value,
            *(self.supervisors.items[item].value for item in (a, b)),
        ):
            copies |= self.copies.bit(value) if value.epoch else 0
        for item in (a, b):
            message = parts.command(self.supervisors.items[item])
            commands |= 0 if message is None else self.commands.bit(message)
        return self.reports.bit(parts.report(self.ends.items[end])), commands, copies

    def _parts(self, state: State, reports: int, commands: int) -> Iterator[tuple[str, State]]:
        for after, words, source in self._once(self._end_moves, state.end, commands, state.copies):
            if source == CONTROL and state.stopped:
                raise BrokenError(
                    f"{words}: control acts after a safe stop was answered, unacknowledged"
                )
            if source == CONTROL and state.reacted:
                raise BrokenError(
                    f"{words}: control acts after the actuator end's own reaction, unacknowledged"
                )
            yield words, state._replace(end=after, ramps=state.ramps and not source)
        reacts = self._once(self._reacts, state.end)
        if reacts is not None:
            yield (
                "end reacts",
                state._replace(end=reacts, ramps=True, reacted=state.reacted or not state.ramps),
            )
        for copies in self._once(self._pressed, state.copies):
            yield "page: SAFE STOP", state._replace(copies=copies)
        for name in ("a", "b"):
            yield from self._at_supervisor(state, name, reports, commands)
        if state.restarts < self.bounds.restarts:
            yield from self._restarts(state)

    def _reacts(self, number: int) -> int | None:
        end = self.ends.items[number]
        after = parts.react(end)
        _grows(end.value, after.value, "end")
        if not after.value.stopped:
            raise BrokenError("end reacts: its register does not say stopped")
        return self.ends.number(after) if after.value.epoch <= self.bounds.epochs else None

    def _end_moves(self, number: int, commands: int, copies: int) -> list[tuple[int, str, str]]:
        end: End = self.ends.items[number]
        moves: dict[tuple[End, str], str] = {}
        for message in self.commands.of(commands):
            refused, acts = self._once(parts.receive, end, message)
            moves.setdefault((refused, ""), f"end refuses {_words(message)}")
            if acts is not None:
                words = f"end obeys {_words(message)}"
                self._judge(end, acts, message, words)
                moves.setdefault((acts, message.source), words)
            if refused.term < end.term or (
                refused.term == end.term and refused.leader != end.leader
            ):
                raise BrokenError(
                    f"{_words(message)}: term {end.term} of {end.leader} is {refused.term} "
                    f"of {refused.leader}"
                )
        for value in self.copies.of(copies):
            moves.setdefault((parts.end_hears(end, value), ""), f"end hears {_value(value)}")
        moves.pop((end, ""), None)
        for after, _ in moves:
            _grows(end.value, after.value, "end")
        return [
            (self.ends.number(after), words, source)
            for (after, source), words in moves.items()
            if after.value.epoch <= self.bounds.epochs
        ]

    def _judge(self, before: End, after: End, message: Message, words: str) -> None:
        signature, source = message
        if (after.term, after.leader) != (
            signature.term,
            signature.leader,
        ) or signature.term < before.term:
            raise BrokenError(f"{words}: an older leader's command acts")
        if source == CONTROL and after.value.stopped:
            raise BrokenError(f"{words}: control acts in a safe stop")
        if source == CONTROL and signature.stop != after.value:
            raise BrokenError(f"{words}: control acts that does not know {_value(after.value)}")

    def _pressed(self, copies: int) -> list[int]:
        """The page's SAFE STOP.

        The page may have heard any copy, and forgotten later ones in a restart.
        """
        pressed = [parts.press(value) for value in (Stop(), *self.copies.of(copies))]
        more = {
            copies | self.copies.bit(value)
            for value in pressed
            if value.epoch <= self.bounds.epochs
        }
        return sorted(more - {copies})

    def _at_supervisor(
        self, state: State, name: str, reports: int, commands: int
    ) -> Iterator[tuple[str, State]]:
        number: int = getattr(state, name)
        for after, words, answered in self._once(
            self._supervisor_moves, number, reports, commands, state.copies
        ):
            stopped = state.stopped or answered
            yield f"{name} {words}", state._replace(**{name: after}, stopped=stopped)
        requested, acknowledged = self._once(self._requests, number)
        if requested is not None and state.requests < self.bounds.requests:
            yield (
                f"{name} is asked for a safe stop",
                state._replace(**{name: requested}, requests=state.requests + 1),
            )
        if acknowledged is not None:
            after = state._replace(**{name: acknowledged})
            if self.supervisors.items[acknowledged].value > self.ends.items[state.end].value:
                a, b = self._once(self._covered, after.a), self._once(self._covered, after.b)
                after = after._replace(a=a, b=b, stopped=False, reacted=False)
            yield f"{name} acknowledges", after

    def _covered(self, number: int) -> int:
        """A supervisor after an acknowledgement.

        It covers a request for a safe stop that was made before.
        """
        supervisor: Supervisor = self.supervisors.items[number]
        return self.supervisors.number(
            supervisor._replace(acknowledged=supervisor.asked is not None)
        )

    def _requests(self, number: int) -> tuple[int | None, int | None]:
        """The supervisor after a request for a safe stop, and after an acknowledgement.

        None where nothing changes.
        """
        before: Supervisor = self.supervisors.items[number]
        after = [parts.ask_stop(before), parts.acknowledge(before)]
        for item in after:
            _grows(before.value, item.value, before.identity)
        changed = [
            item if item != before and item.value.epoch <= self.bounds.epochs else None
            for item in after
        ]
        requested, acknowledged = (
            None if item is None else self.supervisors.number(item) for item in changed
        )
        return requested, acknowledged

    def _supervisor_moves(
        self, number: int, reports: int, commands: int, copies: int
    ) -> list[tuple[int, str, bool]]:
        before: Supervisor = self.supervisors.items[number]
        moves: dict[tuple[Supervisor, bool], str] = {}
        for state in self.reports.of(reports):
            for after, answered in self._once(_hear_report, before, state):
                words = f"hears report {_report(state)}" + (
                    ", answers the safe stop" if answered else ""
                )
                moves.setdefault((after, answered and not before.acknowledged), words)
        for message in self.commands.of(commands):
            if message.signature.leader != before.identity:
                after = self._once(parts.hear_command, before, message)
                moves.setdefault((after, False), f"hears {_words(message)}")
        for value in self.copies.of(copies):
            moves.setdefault(
                (self._once(parts.hear_stop, before, value), False), f"hears {_value(value)}"
            )
        moves.setdefault((self._once(parts.take_over, before), False), "takes over")
        moves.setdefault((self._once(parts.ask_auto, before), False), "is asked for auto")
        moves.pop((before, False), None)
        for after, _ in moves:
            _grows(before.value, after.value, before.identity)
            if after.active and not before.active and after.term <= before.heard_term:
                raise BrokenError(
                    f"{before.identity} takes over: its term {after.term} is not above "
                    f"{before.heard_term}"
                )
        return [
            (self.supervisors.number(after), words, answered)
            for (after, answered), words in moves.items()
            if after.term <= self.bounds.terms and after.value.epoch <= self.bounds.epochs
        ]

    # ---------------------------------------------------------------- restarts

    def _restarts(self, state: State) -> Iterator[tuple[str, State]]:
        """A part begins again, if another one that lives has the newest value of the register."""
        newest = max((Stop(), *self.copies.of(state.copies)))
        end, pair = (
            self.ends.items[state.end],
            {name: self.supervisors.items[getattr(state, name)] for name in ("a", "b")},
        )
        again = state._replace(restarts=state.restarts + 1)
        for name, other in (("a", "b"), ("b", "a")):
            if newest in (end.value, pair[other].value):
                life = int(pair[name].identity[1:]) + 1
                yield (
                    f"{name} restarts",
                    again._replace(**{name: self.supervisors.number(Supervisor(f"{name}{life}"))}),
                )
        if pair["a"].value == pair["b"].value == newest:
            # It hears the newest value before a command; commands that were under way do not reach
            # a new process.
            fresh = self.ends.number(parts.end_hears(End(), newest))
            yield "end restarts", again._replace(end=fresh, life=state.life + 1, ramps=False)

    # ---------------------------------------------------------------- recovery

    def heal(self, state: State) -> None:
        """Deliver what is sent, let one supervisor lead and acknowledge.

        Control must come back.
        """
        self._once(self._heal, state.end, state.a, state.b, state.copies)

    def _heal(self, number: int, a: int, b: int, copies: int) -> None:
        end, pair = self.ends.items[number], [self.supervisors.items[item] for item in (a, b)]
        heard = max((Stop(), *self.copies.of(copies)))
        for _ in range(HEAL_ROUNDS):
            newest = max(end.value, heard, *(item.value for item in pair))
            end = self._once(parts.end_hears, end, newest)
            state = self._once(parts.report, end)
            pair = [
                self._once(parts.hear_report, self._once(parts.hear_stop, item, newest), state)[0]
                for item in pair
            ]
            if not pair[0].active and not pair[1].active:
                pair[0] = self._once(parts.take_over, pair[0])
            for place, item in enumerate(pair):
                message = self._once(parts.command, item)
                acts = None if message is None else self._once(parts.receive, end, message)[1]
                if acts is None:
                    continue
                end = acts
                if message.source == CONTROL:
                    return
                pair[place] = self._once(parts.ask_auto, self._once(parts.acknowledge, item))
        raise BrokenError(
            "no recovery: control does not come back, though all is delivered and acknowledged"
        )


def _hear_report(before: Supervisor, state: ActuatorState) -> list[tuple[Supervisor, bool]]:
    """Of a leader that has answered the last measurement, and of one that has not."""
    return [
        parts.hear_report(before, state._replace(unanswered=unanswered)) for unanswered in (0, 1)
    ]


def _grows(before: Stop, after: Stop, name: str) -> None:
    if after < before:
        raise BrokenError(f"the register of {name} falls from {_value(before)} to {_value(after)}")


def _value(stop: Stop) -> str:
    return (
        f"{stop.epoch} {'stopped' if stop.stopped else 'acknowledged'} ({stop.cause.name.lower()})"
    )


def _words(message: Message) -> str:
    signature = message.signature
    return (
        f"{message.source} of {signature.leader}, term {signature.term}, "
        f"knowing {_value(signature.stop)}"
    )


def _report(state: ActuatorState) -> str:
    return (
        f"term {state.term} of {state.leader or 'nobody'}, {state.source or 'no source'}, "
        f"{_value(state.stop)}"
    )


class Result(NamedTuple):
    """What a search has found; ``path`` leads to what is broken, by a shortest way."""

    states: int
    transitions: int
    depth: int
    broken: str = ""
    path: tuple[str, ...] = ()


def search(bounds: Bounds, heal: bool = True) -> Result:
    """Visit all states breadth first, until an invariant is broken."""
    model = Model(bounds)
    first = model.begin()
    before: dict[State, tuple[State, str] | None] = {first: None}
    layer, transitions, depth = [first], 0, 0
    state = first
    try:
        while layer:
            following = []
            for state in layer:
                if heal:
                    model.heal(state)
                for words, after in model.moves(state):
                    transitions += 1
                    if after not in before:
                        before[after] = (state, words)
                        following.append(after)
            layer, depth = following, depth + bool(following)
    except BrokenError as broken:
        path: list[str] = []
        while (step := before[state]) is not None:
            state = step[0]
            path.append(step[1])
        return Result(len(before), transitions, depth, str(broken), tuple(reversed(path)))
    return Result(len(before), transitions, depth)


def main() -> int:
    """Search within the bounds; returns 1 if an invariant is broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--epochs", type=int, default=3, help="greatest epoch of the register")
    parser.add_argument("--terms", type=int, default=2, help="greatest term")
    parser.add_argument(
        "--restarts", type=int, default=0, help="of supervisors and actuator end, in all"
    )
    parser.add_argument("--requests", type=int, default=1, help="for a safe stop, to a supervisor")
    parser.add_argument(
        "--delayed", type=int, default=0, help="late reports, and late commands, at once"
    )
    args = parser.parse_args()
    begun_s = time.process_time()
    result = search(Bounds(**vars(args)))
    print(f"{result.states} states, {result.transitions} transitions, depth {result.depth}")
    print(f"{time.process_time() - begun_s:.0f} s of CPU", file=sys.stderr)
    if result.broken:
        print("broken after:", *result.path, result.broken, sep="\n  ")
    return bool(result.broken)


if __name__ == "__main__":
    sys.exit(main())
