#!/usr/bin/env python3
"""Every sequence of letters of a welding cell, breadth first; sequences that lead to the same state are merged.

usage: explore.py [--depth N] [--only ALPHABET] [--mode MODE] [--forgive RULE ...]
"""

from __future__ import annotations

import argparse
import multiprocessing
import pickle
import sys
import time
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import isfinite
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from fsw_test_support.welding_cell import ALPHABET, CANDIDATES, BrokenRuleError, Cell, Rules

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
    "safety": ("tick", *SENSORS, "auto", "manual", "hold", "safe_stop", "acknowledge"),
    "control": ("tick", *CANDIDATES, "auto", "manual", "hold", "switch"),
    "all": ALPHABET,
}
#: of these the drives report at every tick and stamps jump with the clock, or a gateway and a PLC are in between
WITH_AND_WITHOUT_GATEWAY = ("link", "all")
#: by starting mode, the letters that lead there from a cell that is in auto
STARTS = {
    "auto": (),
    "manual": ("manual",),
    "hold": ("hold",),
    "safe_stop": ("safe_stop",),
    "tripped": ("trip", "tick", "tick"),
}


def started(mode: str, gateway: bool) -> Cell:
    """A cell in a mode; ``start``: before its first measurement."""
    cell = Cell(gateway)
    if mode != "start":
        for letter in (*["tick"] * 12, *STARTS[mode]):
            cell.step(letter)
    return cell


# ---------------------------------------------------------------- when two cells are the same

#: counts, words and what is constant: no later decision depends on them
_SKIPPED = """settings limits _limits lockstep _lockstep reason requested_by since_ns transitions revision events tick
    _stamp_ns _interlocks hold_s _persistence_ticks reasons _causes who message on_done missed late rejected duplicates
    latencies_s _past _sent foreign_commands jumps counts latency_s samples read gate _machine machine _safety safety
    _registry registry operator watch start _counters ticks paused invalid written failed cut last_failure steps config
    strict stamps _frozen leading last commands lost_ticks stalls _outbox"""
_IRRELEVANT = frozenset(_SKIPPED.split())
#: of these only whether there is any matters
_WHETHER = frozenset(["inhibited", "problem", "failure", "excuse", "refusal"])
#: numbers of ticks, and counts that matter no more when they are large
_TICKS = frozenset(["_mode_tick", "_swapped_tick", "last_tick", "foreign_tick", "_excused_tick"])
_FORGOTTEN_TICKS, _FORGOTTEN_S = 10, 2.0


def state(cell: Cell) -> int:
    """Hash of all that later decisions depend on; times count from now, so that it repeats."""
    arbiter, gateway = cell.arbiter, cell.gateway
    parts = [arbiter.machine, arbiter.safety, arbiter.registry, arbiter.operator, arbiter.watch, arbiter._start]
    parts += [arbiter._arbitration, arbiter._stamps, arbiter.tick, gateway, cell.watchdog, cell.rules]
    own = (cell.in_force, cell.temperature, cell.candidate, cell.linked, cell.delivering, cell.followed, cell.control)
    own = (*own, cell.pushed_kn)
    now = (cell.now_s, cell.stamp_ns, arbiter.machine.tick)
    return hash(tuple(_frozen(part, "", now) for part in (own, *parts)))


def _frozen(value: Any, name: str, now: tuple[float, int, int]) -> Any:
    kind = type(value)
    if value is None or kind is bool or kind is str:
        return bool(value) if name in _WHETHER else value
    if kind is float:
        if name.endswith("_s") and name != "age_s":
            value = max(value - now[0], -_FORGOTTEN_S)
        return round(min(value, 1e9), 3) if isfinite(value) else str(value)
    if kind is int:
        if name in _TICKS:
            return max(value - now[2], -_FORGOTTEN_TICKS)
        return value - now[1] if name.endswith("_ns") else min(value, _FORGOTTEN_TICKS)
    if isinstance(value, Enum):
        return value
    if name == "_automatic":
        return tuple(tick - now[2] for tick in value if now[2] - tick < _FORGOTTEN_TICKS)
    if kind is dict:
        return tuple([(str(key), _frozen(item, "", now)) for key, item in sorted(value.items())])
    if isinstance(value, tuple | list | deque):
        return tuple([_frozen(item, "", now) for item in value])
    if isinstance(value, set | frozenset):
        return tuple(sorted(value))
    return tuple([_frozen(getattr(value, item), item, now) for item in _names(value)])


_NAMES: dict[type, tuple[str, ...]] = {}


def _names(value: Any) -> tuple[str, ...]:
    kind = type(value)
    if kind not in _NAMES:
        names = getattr(kind, "__slots__", ()) or vars(value)
        _NAMES[kind] = tuple(name for name in names if name not in _IRRELEVANT)
    return _NAMES[kind]


def packed(cell: Cell) -> bytes:
    """A copy of a cell to go on from, without its memory of what is only counted or told."""
    cell.arbiter.machine.events.clear()
    for record in cell.arbiter.registry:
        record.latencies_s.clear()
    past = cell.arbiter.registry._past  # of these only the last matter, except in lockstep
    for stamp_ns in list(past)[:-3]:
        del past[stamp_ns]
    return pickle.dumps(cell, pickle.HIGHEST_PROTOCOL)


# ---------------------------------------------------------------- the exploration


@dataclass
class Result:
    """What an exploration has seen; ``broken``: by rule, the shortest sequence of letters and what was wrong."""

    sequences: int = 0
    transitions: int = 0
    states: int = 0
    slowest_recovery: int = 0
    broken: dict[str, tuple[tuple[str, ...], str]] = field(default_factory=dict)

    def note(self, path: Iterable[str], error: BrokenRuleError) -> None:
        """Keep the first sequence that breaks a rule; in breadth first none is shorter."""
        self.broken.setdefault(error.rule, (tuple(path), str(error)))


class Explorer:
    """Explores from one start; a state counts as known whatever sequence led to it."""

    def __init__(self, alphabet: Sequence[str]) -> None:
        self.alphabet = alphabet
        self.result = Result()
        self._ticks_to_control: dict[int, int] = {}

    def explore(self, start: Cell, depth: int) -> Result:
        """Every sequence of ``depth`` letters."""
        result, seen = self.result, {state(start)}
        layer: list[tuple[bytes, tuple[str, ...]]] = [(packed(start), ())]
        for level in range(depth):
            result.sequences += len(self.alphabet) ** (level + 1)
            following: list[tuple[bytes, tuple[str, ...]]] = []
            for copy, path in layer:
                for letter in self.alphabet:
                    cell: Cell = pickle.loads(copy)
                    result.transitions += 1
                    try:
                        decision = cell.step(letter)
                        key = state(cell)
                        if key in seen:
                            continue
                        seen.add(key)
                        after = packed(cell)
                        self._check_order(copy, letter, decision, key)
                        self._check_recovery(cell, key)
                    except BrokenRuleError as error:
                        result.note((*path, letter), error)
                        continue
                    if level + 1 < depth:
                        following.append((after, (*path, letter)))
            layer = following
        result.states = len(seen)
        return result

    def _check_order(self, copy: bytes, letter: str, decision: Any, key: int) -> None:
        """The messages of the tick in another order, which differs from state to state."""
        other: Cell = pickle.loads(copy)
        rank = 1 + key % 40319
        again = other.step(letter, rank)
        if (again and (again.source, again.command)) != (decision and (decision.source, decision.command)):
            raise BrokenRuleError("the order of messages does not matter", f"{decision} or, in order {rank}, {again}")

    def _check_recovery(self, cell: Cell, key: int) -> None:
        """All is well from now on: count the ticks until a controller is in control."""
        keys = list[int]()
        while cell.control < CONTROL_TICKS and key not in self._ticks_to_control:
            keys.append(key)
            if len(keys) > RECOVERY_TICKS:
                words = f"in {RECOVERY_TICKS} ticks; mode {cell.arbiter.machine.mode}, {cell.arbiter.machine.reason}"
                raise BrokenRuleError("a healthy cell returns to control", words)
            cell.heal()
            self.result.transitions += 1
            key = state(cell)
        ticks = self._ticks_to_control.get(key, 0)
        for one in reversed(keys):
            ticks += 1
            self._ticks_to_control[one] = ticks
        self.result.slowest_recovery = max(self.result.slowest_recovery, ticks)


def run(task: tuple[str, str, bool, int]) -> tuple[tuple[str, str, bool, int], Result, float]:
    """Explore one alphabet from one mode."""
    name, mode, gateway, depth = task
    begun_s = time.process_time()
    result = Explorer(ALPHABETS[name]).explore(started(mode, gateway), depth)
    return task, result, time.process_time() - begun_s


def main() -> int:
    """Explore in two processes; returns how many rules are broken."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--depth", type=int, default=6, help="letters per sequence; two less for the alphabet of all")
    parser.add_argument("--only", choices=ALPHABETS, help="this alphabet only")
    parser.add_argument("--mode", choices=("start", *STARTS), help="from this mode only")
    parser.add_argument("--forgive", nargs="*", default=[], metavar="RULE", help="rules that are not checked")
    args = parser.parse_args()
    Rules.forgiven = frozenset(args.forgive)
    tasks = [
        (name, mode, gateway, max(1, args.depth - 2 * (name == "all")))
        for name in ALPHABETS
        for mode in ("start", *STARTS)
        for gateway in ((True, False) if name in WITH_AND_WITHOUT_GATEWAY else (True,))
        if args.only in (None, name) and args.mode in (None, mode)
    ]
    broken: dict[str, tuple[tuple[str, ...], str]] = {}
    print("| alphabet | from | machine | depth | sequences | transitions | states | slowest recovery | CPU [s] |")
    print("|---|---|---|" + "---:|" * 6)
    with multiprocessing.Pool(2) as pool:
        for (name, mode, gateway, depth), result, cpu_s in pool.imap_unordered(run, tasks):
            machine = "gateway and PLC" if gateway else "plant"
            numbers = (
                depth,
                result.sequences,
                result.transitions,
                result.states,
                result.slowest_recovery,
                round(cpu_s),
            )
            print("|", " | ".join([name, mode, machine, *map(str, numbers)]), "|", flush=True)
            for rule, (path, words) in result.broken.items():
                print(f"BROKEN, {name} from {mode}: {' '.join(path)}: {words}", flush=True)
                broken.setdefault(rule, (path, words))
    return len(broken)


if __name__ == "__main__":
    sys.exit(main())
