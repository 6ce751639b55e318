#!/usr/bin/env python3
"""Two supervisors and an actuator end over a lossy network.

Random walks, and all short sequences of a few letters.

Counter-examples are shrunk.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count, product
from math import inf
from pathlib import Path

if __name__ == "__main__":
    sys.path.append(str(Path(__file__).resolve().parents[2] / "scripts"))
    from _bootstrap import ensure

    ensure(dev=True, extras=["machine"])

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from fsw_analysis.report import table
from fsw_test_support import pair_rules, results_page
from fsw_test_support.pair_ends import ENDS, PLC_LINKS
from fsw_test_support.pair_rules import BrokenInvariantError
from fsw_test_support.supervisor_pair import LINKS, PARTS, SUPERVISORS, World

REQUESTS = ("safe_stop", "acknowledge", "hold", "manual", "auto", "switch")
KILLED = ("a", "b", "end", "page")
FROZEN = ("a", "b", "end", "page", "controllers")
#: letters by group; a walk chooses the group first
GROUPS: dict[str, tuple[str, ...]] = {
    "time": ("run 1", "run 1", "run 2", "run 3", "run 5", "run 12", "ms 5", "ms 30", "ms 70"),
    "request": tuple(f"ask {kind} {name}" for kind in REQUESTS for name in SUPERVISORS),
    "restore": tuple(
        f"ask {kind} {name}" for kind in ("acknowledge", "auto") for name in SUPERVISORS
    ),
    "press": ("press",),
    "link": tuple(
        f"link {kind} {source} {target}"
        for kind in ("well", *LINKS)
        for source in PARTS
        for target in PARTS
        if source != target and not (target == "page" and source == "controllers")
    ),
    "isolate": tuple(f"isolate {name}" for name in ("a", "b", "end", "page")),
    "network": (
        "network well",
        "network well",
        "network lossy",
        "network late",
        "network swap",
        "network dup",
    ),
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
    "plc": tuple(
        f"plc {state}" for state in (*PLC_LINKS, "forbids", "well", "permits", "well", "permits")
    ),
}
_WEIGHTS = {
    "time": 30,
    "request": 8,
    "restore": 8,
    "press": 2,
    "link": 8,
    "isolate": 2,
    "network": 4,
    "process": 14,
}
_WEIGHTS |= {"cause": 2, "clock": 1, "wish": 2}
_MORE_DISTURBED = {"link": 20, "process": 28, "isolate": 5}
_END_WEIGHTS = {"plant": _WEIGHTS, "gateway": _WEIGHTS | {"plc": 5}}
LETTERS = tuple(dict.fromkeys(letter for group in GROUPS.values() for letter in group))
#: letters in a walk
LENGTH = 40
#: letters of the short sequences; a tick passes after each
FEW = (
    "run 2",
    "run 12",
    "ask safe_stop a",
    "ask acknowledge a",
    "ask auto a",
    "kill a",
    "start a",
    "kill b",
    "freeze a",
    "thaw a timers",
    "freeze end",
    "thaw end messages",
    "link cut a end",
    "network well",
)


@dataclass
class Found:
    """What an exploration of the pair has seen.

    ``broken``: by invariant, the shortest sequence and what was wrong.
    """

    machine: str = "plant"
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


def walk(
    letters: Sequence[str], machine: str = "plant", forgiven: frozenset[str] = frozenset()
) -> tuple[World, BrokenInvariantError | None]:
    """Do what the letters say, then heal.

    Returns the world and the first invariant that was broken.
    """
    world = World(machine)
    world.rules.forgiven = forgiven
    try:
        for letter in letters:
            world.step(letter)
        world.heal()
    except BrokenInvariantError as error:
        return world, error
    return world, None


def letters_of(seed: int, machine: str = "plant") -> tuple[str, ...]:
    """The letters of a random walk.

    Every other one is twice as long, with more of links and processes.
    """
    chance, weights, length = random.Random(seed), _END_WEIGHTS[machine], LENGTH
    if seed % 2 == 0:
        weights, length = weights | _MORE_DISTURBED, 2 * LENGTH
    groups = chance.choices(list(weights), list(weights.values()), k=length)
    return tuple(chance.choice(GROUPS[name]) for name in groups)


def random_walks(seed: int, machine: str) -> Iterator[tuple[str, ...]]:
    """The letters of endless walks; the seed counts on."""
    return (letters_of(number, machine) for number in count(seed))


def short_sequences(depth: int) -> Iterator[tuple[str, ...]]:
    """Every sequence of ``depth`` of the few letters, with a tick after each."""
    for letters in product(FEW, repeat=depth):
        yield tuple(part for letter in letters for part in (letter, "run 1"))


def shrink(
    letters: Sequence[str],
    rule: str,
    machine: str = "plant",
    forgiven: frozenset[str] = frozenset(),
) -> tuple[str, ...]:
    """Leave out letters for as long as the same invariant is broken (delta debugging)."""
    left, size = list(letters), max(1, len(letters) // 2)
    while True:
        begin, shorter = 0, False
        while begin < len(left):
            trial = left[:begin] + left[begin + size :]
            error = walk(trial, machine, forgiven)[1]
            if error is not None and error.rule == rule:
                left, shorter = trial, True
            else:
                begin += size
        if size == 1 and not shorter:
            return tuple(left)
        size = size if shorter and size == 1 else max(1, size // 2)


def explore(
    sequences: Iterable[tuple[str, ...]],
    machine: str,
    transitions: float = inf,
    forgiven: frozenset[str] = frozenset(),
    cpu_s: float = inf,
) -> Iterator[Found]:
    """Walk sequences of letters until so many transitions are done.

    Yields the counts after each walk.
    """
    result, begun_s = Found(machine), time.process_time()
    for letters in sequences:
        world, error = walk(letters, machine, forgiven)
        result.add(world)
        result.letters.update(letters)
        if error is not None and error.rule not in result.broken:
            short = shrink(letters, error.rule, machine, forgiven)
            result.broken[error.rule] = (short, str(walk(short, machine, forgiven)[1]))
        yield result
        if result.transitions >= transitions or time.process_time() - begun_s >= cpu_s:
            return


# ---------------------------------------------------------------- runs and their results


def run(
    kind: str, sequences: Iterable[tuple[str, ...]], machine: str, transitions: float = inf
) -> results_page.Row:
    """Explore and print; returns the figures."""
    result, shown, begun_s = Found(machine), 0, time.process_time()
    for result in explore(sequences, machine, transitions):
        if result.transitions - shown >= 1_000_000:
            shown = result.transitions
            print(
                f"{machine}: {shown} transitions in {result.walks} walks, "
                f"broken: {sorted(result.broken)}",
                flush=True,
            )
    cpu_s = time.process_time() - begun_s
    rate = result.transitions / max(cpu_s, 1e-9)
    print(
        f"{machine}, {kind}: {result.transitions} transitions in {result.walks} walks, "
        f"{rate:.0f} a second of CPU"
    )
    print(
        f"{result.accepted} commands acted; control was back after at most "
        f"{result.slowest_s:.1f} s",
        flush=True,
    )
    for rule, (letters, words) in sorted(result.broken.items()):
        print(f"{rule}: {', '.join(letters)}: {words}", flush=True)
    row: results_page.Row = {
        "machine": machine,
        "kind": kind,
        "walks": result.walks,
        "transitions": result.transitions,
    }
    return row | {
        "accepted": result.accepted,
        "slowest_s": result.slowest_s,
        "broken": result.broken,
        "cpu_s": cpu_s,
    }


def page(rows: Sequence[results_page.Row]) -> str:
    """Invariants and table of the results page, and what is broken."""
    lines = [f"- **{name}** {words}" for name, words in pair_rules.INVARIANTS.items()]
    lines += ["", f"Fault model: {pair_rules.FAULT_MODEL}", ""]
    numbers = (
        "number",
        "transitions",
        "commands acted",
        "slowest return [s]",
        "broken",
        "CPU [s]",
    )
    cells: list[Sequence[object]] = [("machine", "sequences", *numbers)]
    for row in rows:
        counts = [f"{row[name]:,}" for name in ("walks", "transitions", "accepted")]
        ends = [
            f"{row['slowest_s']:.1f}",
            ", ".join(sorted(row["broken"])) or "none",
            round(row["cpu_s"]),
        ]
        cells.append((row["machine"], row["kind"], *counts, *ends))
    lines += [
        table(cells, words=2),
        "",
        f"Together {sum(row['transitions'] for row in rows):,} transitions.",
    ]
    for row in rows:
        lines += [
            f"\n- {row['machine']}, `{', '.join(path)}`: {words}."
            for path, words in row["broken"].values()
        ]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Walk at both ends; returns how many invariants are broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--machine", choices=(*ENDS, "both"), default="both", help="the actuator end"
    )
    parser.add_argument(
        "--transitions",
        type=int,
        default=10_000_000,
        help="events and letters of random walks in all",
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="of the first walk; the next ones count on"
    )
    parser.add_argument(
        "--depth",
        type=int,
        default=0,
        help="before that, every sequence of so many of a few letters",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="enter the figures here")
    parser.add_argument(
        "--publish", type=Path, metavar="FILE", help="write such figures into the results page"
    )
    args = parser.parse_args()
    if args.publish:
        results_page.publish(
            "invariants-pair.md", "pair results", page(results_page.load(args.publish))
        )
        return 0
    machines, broken = (tuple(ENDS) if args.machine == "both" else (args.machine,)), 0
    for machine in machines:
        each = args.transitions / len(machines)
        short = (
            f"all of {args.depth} of {len(FEW)} letters",
            short_sequences(args.depth),
            machine,
        )
        rows = [run(*short)] if args.depth else []
        rows += (
            [
                run(
                    f"random, from seed {args.seed}",
                    random_walks(args.seed, machine),
                    machine,
                    each,
                )
            ]
            if each
            else []
        )
        broken += sum(len(row["broken"]) for row in rows)
        for row in rows if args.json else ():
            results_page.save(row, args.json, ("machine", "kind"))
    return broken


if __name__ == "__main__":
    sys.exit(main())
