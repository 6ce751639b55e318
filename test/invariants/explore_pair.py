#!/usr/bin/env python3
"""Random walks of two supervisors and a plant over a lossy network, with shrunk counter-examples.

usage: explore_pair.py [--transitions N] [--seed N]
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from fsw_test_support.pair_rules import BrokenInvariantError
from fsw_test_support.supervisor_pair import LINKS, PARTS, SUPERVISORS, World

REQUESTS = ("safe_stop", "acknowledge", "hold", "manual", "auto", "switch")
KILLED = ("a", "b", "end", "page")
FROZEN = ("a", "b", "end", "page", "controllers")
#: letters by group; a walk chooses the group first
GROUPS: dict[str, tuple[str, ...]] = {
    "time": ("run 1", "run 1", "run 2", "run 3", "run 5", "run 12", "ms 5", "ms 30", "ms 70"),
    "request": tuple(f"ask {kind} {name}" for kind in REQUESTS for name in SUPERVISORS),
    "restore": tuple(f"ask {kind} {name}" for kind in ("acknowledge", "auto") for name in SUPERVISORS),
    "press": ("press",),
    "link": tuple(
        f"link {kind} {source} {target}"
        for kind in ("well", *LINKS)
        for source in PARTS
        for target in PARTS
        if source != target and not (target == "page" and source == "controllers")
    ),
    "isolate": tuple(f"isolate {name}" for name in ("a", "b", "end", "page")),
    "network": ("network well", "network well", "network lossy", "network late", "network swap", "network dup"),
    "process": (
        *(f"freeze {name}" for name in FROZEN),
        *(f"thaw {name} {first}" for name in FROZEN for first in ("timers", "messages")),
        *(f"kill {name}" for name in KILLED),
        *(f"start {name}" for name in KILLED),
        *(f"start {name}" for name in KILLED),
    ),
    "cause": ("temperature 920", "temperature 885", "temperature nan", "temperature 885"),
    "clock": ("clock 0.9", "clock -0.9", "clock 3600", "clock -3600"),
    "wish": ("wish 84", "wish 78"),
}
_WEIGHTS = {"time": 30, "request": 8, "restore": 8, "press": 2, "link": 8, "isolate": 2, "network": 4, "process": 14}
_WEIGHTS |= {"cause": 2, "clock": 1, "wish": 2}
LETTERS = tuple(dict.fromkeys(letter for group in GROUPS.values() for letter in group))
#: letters in a walk
LENGTH = 40


@dataclass
class Found:
    """What an exploration of the pair has seen; ``broken``: by invariant, the shortest sequence and what was wrong."""

    walks: int = 0
    transitions: int = 0
    accepted: int = 0  #: commands that acted
    slowest_s: float = 0.0  #: until control was back
    letters: Counter[str] = field(default_factory=Counter)
    answers: Counter[tuple[str, bool | None]] = field(default_factory=Counter)
    broken: dict[str, tuple[tuple[str, ...], str]] = field(default_factory=dict)

    def add(self, world: World) -> None:
        """Add the counts of a walk."""
        self.walks += 1
        self.transitions += world.transitions
        self.accepted += world.rules.accepted
        self.slowest_s = max(self.slowest_s, world.slowest_s)
        self.answers.update((request.kind, request.ok) for request in world.answers)


def walk(letters: Sequence[str], forgiven: frozenset[str] = frozenset()) -> tuple[World, BrokenInvariantError | None]:
    """Do what the letters say, then heal; returns the world and the first invariant that was broken."""
    world = World()
    world.rules.forgiven = forgiven
    try:
        for letter in letters:
            world.step(letter)
        world.heal()
    except BrokenInvariantError as error:
        return world, error
    return world, None


def letters_of(seed: int, length: int = LENGTH) -> tuple[str, ...]:
    """The letters of a random walk."""
    chance = random.Random(seed)
    names, weights = list(_WEIGHTS), list(_WEIGHTS.values())
    return tuple(chance.choice(GROUPS[name]) for name in chance.choices(names, weights, k=length))


def shrink(letters: Sequence[str], rule: str, forgiven: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """Leave out letters for as long as the same invariant is broken (delta debugging)."""
    left, size = list(letters), max(1, len(letters) // 2)
    while True:
        begin, shorter = 0, False
        while begin < len(left):
            trial = left[:begin] + left[begin + size :]
            error = walk(trial, forgiven)[1]
            if error is not None and error.rule == rule:
                left, shorter = trial, True
            else:
                begin += size
        if size == 1 and not shorter:
            return tuple(left)
        size = size if shorter and size == 1 else max(1, size // 2)


def walks(
    seed: int, transitions: int, forgiven: frozenset[str] = frozenset(), cpu_s: float = float("inf")
) -> Iterator[Found]:
    """Random walks until so many transitions are done; yields the counts after each walk."""
    found, begun_s = Found(), time.process_time()
    while found.transitions < transitions and time.process_time() - begun_s < cpu_s:
        letters = letters_of(seed)
        world, error = walk(letters, forgiven)
        found.add(world)
        found.letters.update(letters)
        if error is not None and error.rule not in found.broken:
            short = shrink(letters, error.rule, forgiven)
            found.broken[error.rule] = (short, str(walk(short, forgiven)[1]))
        seed += 1
        yield found


def main() -> int:
    """Walk until so many transitions are done; returns how many invariants are broken."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--transitions", type=int, default=10_000_000, help="events and letters in all")
    parser.add_argument("--seed", type=int, default=1, help="of the first walk; the next ones count on")
    args = parser.parse_args()
    found, shown, begun_s = Found(), 0, time.process_time()
    for found in walks(args.seed, args.transitions):
        if found.transitions - shown >= 1_000_000:
            shown = found.transitions
            print(f"{found.transitions} transitions in {found.walks} walks, broken: {sorted(found.broken)}", flush=True)
    rate = found.transitions / max(time.process_time() - begun_s, 1e-9)
    print(f"{found.transitions} transitions in {found.walks} walks, {rate:.0f} a second of CPU")
    print(f"{found.accepted} commands acted; control was back after at most {found.slowest_s:.1f} s")
    for rule, (letters, words) in sorted(found.broken.items()):
        print(f"{rule}: {', '.join(letters)}: {words}")
    return len(found.broken)


if __name__ == "__main__":
    sys.exit(main())
