#!/usr/bin/env python3
"""Every sequence of letters of a welding cell, breadth first.

Sequences that lead to the same state are merged.
"""

from __future__ import annotations

import argparse
import pickle
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, is_dataclass
from enum import Enum
from functools import cache
from math import isfinite
from pathlib import Path
from types import NoneType
from typing import Any

if __name__ == "__main__":
    sys.path.append(str(Path(__file__).resolve().parents[2] / "scripts"))
    from _bootstrap import ensure

    ensure(dev=True, extras=["machine"])

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from fsw_analysis.report import table
from fsw_control.units import NANOSECONDS
from fsw_control.weld import TICK_NS
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import Tick
from fsw_test_support import results_page
from fsw_test_support.results_page import Row
from fsw_test_support.welding_cell import (
    ALPHABET,
    CANDIDATES,
    RESTART,
    BrokenRuleError,
    Cell,
    Rules,
)

#: with all well again and the operator's help, a controller is back in control after so many ticks
RECOVERY_TICKS = 40
#: in control: so many commands of a controller in a row have come into force
CONTROL_TICKS = 3
SENSORS = ("good", "warn", "trip", "bad", "beyond", "missing")
#: letters that are explored together, to a greater depth than all at once
ALPHABETS = {
    "link": (
        "tick",
        "lost",
        "restored",
        "dropped",
        "delivered",
        "forward",
        "back",
        "push",
        "released",
        "manual",
        "auto",
        "trip",
    ),
    "safety": ("tick", *SENSORS, "auto", "manual", "hold", "safe_stop", "acknowledge", RESTART),
    "control": ("tick", *CANDIDATES, "auto", "manual", "hold", "safe_stop", "switch", RESTART),
    "all": ALPHABET,
}
#: of these the drives report at every tick and stamps jump with the clock, or a gateway and a PLC
#: are in between
WITH_AND_WITHOUT_GATEWAY = ("link", "all")
GATEWAY = "gateway and PLC"
#: whether a gateway is in between
MACHINES = {GATEWAY: True, "plant": False}
#: by starting mode, the letters that lead there from a cell that is in auto
STARTS = {
    "auto": (),
    "manual": ("manual",),
    "hold": ("hold",),
    "safe_stop": ("safe_stop",),
    "tripped": ("trip", "tick", "tick"),
}
MODES = ("start", *STARTS)


def started(mode: str, gateway: bool) -> Cell:
    """A cell in a mode; ``start``: before its first measurement."""
    cell = Cell(gateway)
    if mode != "start":
        for letter in (*["tick"] * 12, *STARTS[mode]):
            cell.step(letter)
    return cell


# ---------------------------------------------------------------- when two cells are the same

#: counts, words and what is constant: no later decision depends on them, or :func:`state` adds
#: what does
_SKIPPED = """settings limits _limits lockstep _lockstep reason cause since_ns transitions revision events tick
    _stamp_ns _interlocks hold_s _persistence_s reasons _causes who message on_done missed late rejected duplicates
    latencies_s _past _sent foreign_commands jumps counts latency_s samples read gate _machine machine _safety safety
    _registry registry operator _operator watch in_force _in_force start_up answered decision _counters ticks paused
    invalid written failed cut last_failure steps config
    strict stamps _frozen silent_ticks _begun_tick _mode_tick time_ns mode_since_ns step_s
    _origin_ns _periods manual _measured_s _answered_ns"""
_IRRELEVANT = frozenset(_SKIPPED.split())
#: of these only whether there is any matters
_WHETHER = frozenset(["inhibited", "problem", "failure", "excuse", "refusal"])
#: numbers of ticks, and counts that matter no more when they are large
_TICKS = frozenset(["foreign_tick", "_excused_tick"])
#: times on the clock of the time-outs, which are multiples of a tick here
_TIMES = frozenset(["_swapped_ns", "expires_ns", "blind_since_ns", "_judged_ns"])
_FORGOTTEN_TICKS, _FORGOTTEN_S = 10, 2.0
#: more than the clock can jump within a sequence
_LONG_AGO_NS = 10**14
#: of these a smaller number is enough: nobody asks for more
_ENOUGH = {"consecutive_good": 5, "_follows": 3, "_stays": 3}
#: modes without a time-out
_LASTING_MODES = (Mode.AUTO, Mode.SAFE_STOP)


def state(cell: Cell) -> int:
    """Hash of all that later decisions depend on; times are ages, so that it repeats.

    Ages are hardly ever negative: of -1 and -2 Python makes the same hash.
    """
    arbiter, gateway = cell.arbiter, cell.gateway
    machine, start_up, operator = arbiter.machine, arbiter._start_up, arbiter.operator
    parts = [machine, arbiter.safety, arbiter.registry, operator, arbiter.watch, start_up]
    parts += [
        arbiter.in_force,
        arbiter.ticks._arbitration,
        arbiter.ticks._stamps,
        arbiter.ticks.present,
    ]
    parts += [gateway, cell.plc.watchdog, cell.rules]
    own = (
        cell.in_force,
        cell.temperature,
        cell.candidate,
        cell.linked,
        cell.delivering,
        cell.followed,
        cell.source,
    )
    own += (cell.pushed_kn, min(cell.control, CONTROL_TICKS), arbiter.ticks.last is None)
    own += (*arbiter.safety.sensor_flaws.values(), arbiter.safety.held_sensors)
    own += (0 if machine.mode in _LASTING_MODES else machine.time_ns - machine.mode_since_ns,)
    own += (machine.ticks_in_mode if machine.mode is Mode.START else 0,)
    own += (operator.manual if machine.mode is Mode.MANUAL else None,)
    listening_ends_s = start_up.listening_ends_s
    own += (None if listening_ends_s is None else max(listening_ends_s - cell.now_s, -1.0),)
    # While nothing is measured the clock may jump.
    shift_ns = 0 if gateway is None else gateway.stamps.shift_ns
    own += ((cell.clock_ns + shift_ns - cell.stamp_ns) / NANOSECONDS,)
    now = (cell.now_s, cell.stamp_ns, machine.tick, machine.time_ns, machine.register.value.epoch)
    return hash(tuple([_FREEZERS[type(part)](part, "", now) for part in (own, *parts)]))


_Now = tuple[float, int, int, int, int]


class _Freezers(dict[type, Callable[[Any, str, _Now], Any]]):
    """By type, what makes of an attribute's value and name something to hash.

    Found once for each type.
    """

    def __missing__(self, kind: type) -> Callable[[Any, str, _Now], Any]:
        bases = (
            (Enum, _plain),
            (dict, _dict),
            ((tuple, list, deque), _items),
            ((set, frozenset), _set),
        )
        freeze = next((freeze for base, freeze in bases if issubclass(kind, base)), None)
        self[kind] = freeze or _object_freezer()
        return self[kind]


def _plain(value: Any, name: str, now: _Now) -> Any:
    return bool(value) if name in _WHETHER else value


def _float(value: float, name: str, now: _Now) -> Any:
    if name.endswith("_s") and name != "age_s":
        value = min(now[0] - value, _FORGOTTEN_S)
    elif name == "age_s":
        value = min(value, _FORGOTTEN_S)
    return round(value, 3) if isfinite(value) else str(value)


def _int(value: int, name: str, now: _Now) -> int:
    if name == "epoch":
        return value - now[4]
    if name in _TICKS:
        return min(now[2] - value, _FORGOTTEN_TICKS)
    if name in _TIMES:
        return min(now[3] - value, _FORGOTTEN_TICKS * TICK_NS)
    if name.endswith("_ns"):
        return min(now[1] - value, _LONG_AGO_NS)
    return min(value, _ENOUGH.get(name, _FORGOTTEN_TICKS))


def _dict(value: dict[Any, Any], name: str, now: _Now) -> tuple[Any, ...]:
    return tuple(
        [(str(key), _FREEZERS[type(item)](item, "", now)) for key, item in sorted(value.items())]
    )


def _items(value: Iterable[Any], name: str, now: _Now) -> tuple[Any, ...]:
    if name == "_automatic":
        return tuple(
            [
                now[3] - time_ns
                for time_ns in value
                if now[3] - time_ns < _FORGOTTEN_TICKS * TICK_NS
            ]
        )
    return tuple([_FREEZERS[type(item)](item, "", now) for item in value])


def _set(value: Iterable[Any], name: str, now: _Now) -> tuple[Any, ...]:
    return tuple(sorted(value))


def _object_freezer() -> Callable[[Any, str, _Now], Any]:
    names: tuple[str, ...] = ()

    def freeze(value: Any, name: str, now: _Now) -> tuple[Any, ...]:
        nonlocal names
        names = names or tuple(
            slot
            for slot in getattr(value, "_fields", getattr(value, "__slots__", ())) or vars(value)
            if slot not in _IRRELEVANT
        )
        return tuple(
            [
                _FREEZERS[type(item := getattr(value, attribute))](item, attribute, now)
                for attribute in names
            ]
        )

    return freeze


_FREEZERS = _Freezers(
    {kind: _plain for kind in (type(None), bool, str)} | {float: _float, int: _int}
)
_FREEZERS[Tick] = _object_freezer()  # a tuple whose fields are times


def packed(cell: Cell) -> bytes:
    """A copy of a cell to go on from, without its memory of what is only counted or told."""
    cell.arbiter.machine.events.clear()
    for record in cell.arbiter.registry:
        record.latencies_s.clear()
    past = cell.arbiter.registry._past  # of these only the last matter, except in lockstep
    for stamp_ns in list(past)[:-3]:
        del past[stamp_ns]
    return pickle.dumps(cell, pickle.HIGHEST_PROTOCOL)


@cache
def _never_changes(kind: type) -> bool:
    frozen = is_dataclass(kind) and kind.__dataclass_params__.frozen
    return frozen or issubclass(kind, (str, int, float, Enum, frozenset, NoneType))


class Snapshot:
    """What a cell holds at a moment, to put it back to as often as needed.

    Much cheaper than copies of the cell.
    """

    def __init__(self, cell: Cell) -> None:
        self._containers: list[tuple[Any, Any]] = []
        self._objects: list[tuple[dict[str, Any], dict[str, Any]]] = []
        self._slotted: list[tuple[Any, list[tuple[str, Any]]]] = []
        known, ahead = set[int](), [cell]
        while ahead:
            situation = ahead.pop()
            kind = type(situation)
            if _never_changes(kind) or id(situation) in known:
                continue
            known.add(id(situation))
            if isinstance(situation, tuple):
                ahead.extend(situation)
            elif isinstance(situation, dict):
                self._containers.append((situation, dict(situation)))
                ahead.extend(situation.values())
            elif isinstance(situation, list | deque | set):
                self._containers.append((situation, tuple(situation)))
                ahead.extend(situation)
            elif hasattr(situation, "__dict__"):
                self._objects.append((vars(situation), dict(vars(situation))))
                ahead.extend(vars(situation).values())
            else:
                values = [(name, getattr(situation, name)) for name in kind.__slots__]
                self._slotted.append((situation, values))
                ahead.extend(value for _, value in values)

    def restore(self) -> None:
        """Put the cell back."""
        for container, items in self._containers:
            container.clear()
            (container.extend if isinstance(container, list | deque) else container.update)(items)
        for attributes, values in self._objects:
            attributes.update(values)
        for kind, slots in self._slotted:
            for name, value in slots:
                setattr(kind, name, value)


# ---------------------------------------------------------------- the exploration


@dataclass
class Result:
    """What an exploration has seen.

    ``broken``: by rule, the shortest sequence of letters and what was wrong.
    """

    sequences: int = 0
    transitions: int = 0
    states: int = 0
    slowest_recovery: int = 0
    broken: dict[str, tuple[tuple[str, ...], str]] = field(default_factory=dict)

    def note(self, path: Iterable[str], error: BrokenRuleError) -> None:
        """Keep the first sequence that breaks a rule; in breadth first none is shorter."""
        self.broken.setdefault(error.rule, (tuple(path), str(error)))


class Explorer:
    """Explores from all starts at once.

    A state counts as known whatever start and sequence led to it first.

    It is gone on from there, at the least depth at which any start reaches it: so every sequence
    of every start is covered.
    """

    def __init__(self, alphabet: Sequence[str]) -> None:
        self.alphabet = alphabet
        self.result = Result()
        self._seen = set[int]()
        self._ticks_to_control: dict[int, int] = {}

    def explore(self, starts: Mapping[str, Cell], depth: int) -> Result:
        """Every sequence of up to ``depth`` letters from each of the starts, which have names."""
        for _ in self.levels(starts, depth):
            pass
        return self.result

    def levels(self, starts: Mapping[str, Cell], depth: int) -> Iterator[int]:
        """As :meth:`explore`; yields each depth when all its sequences are done."""
        result = self.result
        self._seen.update(state(start) for start in starts.values())
        layer: list[tuple[bytes, tuple[str, ...]]] = [
            (packed(start), (name,)) for name, start in starts.items()
        ]
        for level in range(1, depth + 1):
            result.sequences += len(starts) * len(self.alphabet) ** level
            last = level == depth
            layer = [new for copy, path in layer for new in self._go_on(copy, path, last)]
            result.states = len(self._seen)
            yield level

    def _go_on(
        self, copy: bytes, path: tuple[str, ...], last: bool
    ) -> Iterator[tuple[bytes, tuple[str, ...]]]:
        """Try every letter.

        Yields copies of the new states, unless these are the ``last`` ones.
        """
        cell: Cell = pickle.loads(copy)
        before = Snapshot(cell)
        for letter in self.alphabet:
            before.restore()
            if cell.is_already(letter):
                continue
            self.result.transitions += 1
            try:
                decision = cell.step(letter)
                key = state(cell)
                if key in self._seen:
                    continue
                self._seen.add(key)
                after = b"" if last else packed(cell)
                self._check_recovery(cell, key)
                before.restore()
                self._check_order(cell, letter, decision)
            except BrokenRuleError as error:
                self.result.note((*path, letter), error)
                continue
            if after:
                yield after, (*path, letter)

    def _check_order(self, cell: Cell, letter: str, decision: Any) -> None:
        """The messages of the tick in another order, which differs from state to state."""
        rank = 1 + self.result.transitions % 40319
        again = cell.step(letter, rank)
        if (again and (again.source, again.command)) != (
            decision and (decision.source, decision.command)
        ):
            raise BrokenRuleError(
                "the order of messages does not matter", f"{decision} or, in order {rank}, {again}"
            )

    def _check_recovery(self, cell: Cell, key: int) -> None:
        """All is well from now on: count the ticks until a controller is in control."""
        keys = list[int]()
        while cell.control < CONTROL_TICKS and key not in self._ticks_to_control:
            keys.append(key)
            if len(keys) > RECOVERY_TICKS:
                machine = cell.arbiter.machine
                words = f"in {RECOVERY_TICKS} ticks; mode {machine.mode}, {machine.reason.words}"
                raise BrokenRuleError("a healthy cell returns to control", words)
            cell.heal()
            self.result.transitions += 1
            key = state(cell)
        ticks = self._ticks_to_control.get(key, 0)
        for step_key in reversed(keys):
            ticks += 1
            self._ticks_to_control[step_key] = ticks
        self.result.slowest_recovery = max(self.result.slowest_recovery, ticks)


# ---------------------------------------------------------------- runs and their results


def rows_of(name: str, machine: str, modes: Sequence[str], depth: int) -> Iterator[Row]:
    """Explore one alphabet.

    Yields the figures after each letter, so that a run that is cut off is a result, too.
    """
    explorer, begun_s = Explorer(ALPHABETS[name]), time.process_time()
    for reached in explorer.levels(
        {mode: started(mode, MACHINES[machine]) for mode in modes}, depth
    ):
        row = {
            "alphabet": name,
            "machine": machine,
            "modes": len(modes),
            "letters": len(ALPHABETS[name]),
        }
        yield (
            row
            | {"depth": reached}
            | asdict(explorer.result)
            | {"cpu_s": time.process_time() - begun_s}
        )


def page(rows: Sequence[Row]) -> str:
    """The table of the results page, and the totals."""
    counted = ("sequences", "transitions", "states")
    cells = [("alphabet", "machine", "letters", "depth", *counted, "slowest recovery", "CPU [s]")]
    for row in rows:
        numbers = (
            row["letters"],
            row["depth"],
            *(f"{row[name]:,}" for name in counted),
            row["slowest_recovery"],
        )
        cells.append((row["alphabet"], row["machine"], *numbers, round(row["cpu_s"])))
    total = {name: f"{sum(row[name] for row in rows):,}" for name in counted}
    slowest = max(row["slowest_recovery"] for row in rows)
    broken = {rule: value for row in rows for rule, value in row["broken"].items()}
    text = "Together {sequences} sequences, {transitions} transitions between {states} states.".format(
        **total
    )
    text += f" The slowest recovery took {slowest} ticks. Rules violated: {len(broken) or 'none'}."
    lines = [table(cells, words=2), "", text]
    lines += [f"\n- After `{' '.join(path)}`: {words}." for path, words in broken.values()]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Explore one alphabet after the other; returns how many rules are broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--depth",
        type=int,
        default=6,
        help="letters per sequence; two less for the alphabet of all",
    )
    parser.add_argument("--only", choices=ALPHABETS, help="this alphabet only")
    parser.add_argument("--machine", choices=MACHINES, help="with this machine only")
    parser.add_argument("--mode", choices=MODES, help="from this mode only")
    parser.add_argument(
        "--forgive", nargs="*", default=[], metavar="RULE", help="rules that are not checked"
    )
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="enter the figures here after each letter"
    )
    parser.add_argument(
        "--publish", type=Path, metavar="FILE", help="write such figures into the results page"
    )
    args = parser.parse_args()
    if args.publish:
        results_page.publish("invariants.md", "results", page(results_page.load(args.publish)))
        return 0
    Rules.forgiven = frozenset(args.forgive)
    broken = set[str]()
    for name in ALPHABETS if args.only is None else (args.only,):
        for machine in MACHINES if name in WITH_AND_WITHOUT_GATEWAY else (GATEWAY,):
            if args.machine not in (None, machine):
                continue
            depth = max(1, args.depth - 2 * (name == "all"))
            for row in rows_of(name, machine, (args.mode,) if args.mode else MODES, depth):
                if args.json:
                    results_page.save(row, args.json, ("alphabet", "machine", "modes"))
            print(page([row]), flush=True)
            broken |= row["broken"].keys()
    return len(broken)


if __name__ == "__main__":
    sys.exit(main())
