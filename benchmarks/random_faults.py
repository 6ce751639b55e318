#!/usr/bin/env python3
"""Random faults in real time: parts are killed, stopped, cut off and flooded.

What is lost, and how long it lasts.

Two graphs run at once, both with two controllers, two supervisors, a recorder and the operator's
page: one with the emulated plant, one with the gateway and an OPC UA machine behind a proxy. A
part that was killed is started again as the launch file does. Between two faults the graph must be
healthy: a command of a controller for each of 20 ticks in a row, and every part there. An operator
is played, too: after a safe stop he acknowledges it and asks for auto.

Interlocks are as wide as in the tests of faults, because seconds without control leave the process
window.

usage: random_faults.py [--quick] [--trials N] [--seed N] [--json FILE] [--out FOLDER] [--publish]
"""

from __future__ import annotations

import random
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from math import isnan
from pathlib import Path
from typing import Any

from _benchmark import RESULTS, Figures, parser, records, save, show  # isort: skip
import pandas as pd
from random_faults_graph import EMULATOR, MACHINE, FaultyGraph

from fsw.console import ProgressBar
from fsw_analysis.report import numbers as in_lines
from fsw_analysis.report import table
from fsw_control.free_domain import free_domain
from fsw_test_support.results_page import publish

#: a trial without recovery by then has failed [s]
PATIENCE_S = 60.0
#: how long a flood, a stop or a cut lasts, at least and at most [s]
SHORTEST_S, LONGEST_S = 0.2, 4.0

RESULT = RESULTS / "random-faults.md"
#: what --publish writes: each kind of fault and part, and a part of the page
TABLES = RESULT.with_name("random-faults_tables.json")
MARK = "results"
TITLES = {"plant": "emulated plant", "machine": "emulated machine"}

Row = dict[str, Any]


def draw(random_: random.Random, graph: FaultyGraph) -> tuple[str, str, float]:
    """Kind of the fault, what it hits, and for how long [s]."""
    kind = random_.choice(
        ["kill", "kill", "stop", "flood", *(["cut", "clock"] if graph.has_machine else [])]
    )
    lasting_s = round(random_.uniform(SHORTEST_S, LONGEST_S), 2)
    if kind in ("kill", "stop"):
        return kind, random_.choice(graph.parts), lasting_s
    return (
        kind,
        {"cut": "link", "clock": "machine"}.get(kind) or random_.choice(graph.floods),
        lasting_s,
    )


def strike(graph: FaultyGraph, kind: str, target: str, lasting_s: float) -> None:
    """Make a fault and let it end."""
    if kind == "kill":
        graph.signal(target, signal.SIGKILL)
    elif kind == "stop":
        graph.signal(target, signal.SIGSTOP)
        graph.spin_for(lasting_s)
        graph.signal(target, signal.SIGCONT)
    elif kind == "cut":
        graph.cut_link(lasting_s)
    elif kind == "clock":
        graph.signal("machine", signal.SIGUSR1)
    else:
        graph.flood(target, lasting_s)


def trial(graph: FaultyGraph, random_: random.Random) -> Row:
    """One fault, and the way back to health."""
    kind, target, lasting_s = draw(random_, graph)
    graph.observer.begin_trial()
    strike(graph, kind, target, lasting_s)
    struck_s = time.monotonic()
    recovered = graph.spin_until(graph.healthy, PATIENCE_S)
    return {
        "fault": f"{kind} {target}",
        "lasting_s": lasting_s if kind != "kill" else 0.0,
        "recovered": recovered,
        "recovery_s": round(max(0.0, graph.healthy_since_s - struck_s), 2) if recovered else None,
        **graph.observer.end_trial(),
    }


def run(
    parts: Sequence[str], folder: Path, trials: int, seed: int, tell: Callable[[], None]
) -> tuple[list[Row], Row]:
    """All trials of one graph, and what its bags say."""
    random_, rows = random.Random(seed), []
    with free_domain() as domain, FaultyGraph(parts, folder, domain) as graph:
        if not graph.spin_until(graph.healthy, PATIENCE_S):
            raise SystemExit(f"the graph did not become healthy: {graph.describe()}")
        for _ in range(trials):
            rows.append(trial(graph, random_))
            tell()
            if not rows[-1]["recovered"]:
                print(
                    f"no recovery after {rows[-1]['fault']}: {graph.describe()}",
                    file=sys.stderr,
                    flush=True,
                )
                if not graph.start_over(PATIENCE_S):
                    break
        codes = graph.stop()
    moved = {"largest_move_taken": graph.largest_move_taken()} if graph.has_machine else {}
    return rows, {
        **moved,
        "unclean_ends": [name for name, code in codes.items() if code],
        **graph.bags(),
    }


def _middle(values: pd.Series) -> Any:
    """Median; of two in the middle the larger."""
    return values.quantile(0.5, "higher")


def by_fault(rows: list[Row]) -> list[Row]:
    """One row per kind of fault and part."""
    trials = pd.DataFrame(rows).astype({"recovery_s": float}).groupby("fault")
    faults = trials.agg(
        trials=("recovered", "size"),
        recovered=("recovered", "sum"),
        recovery_median_s=("recovery_s", _middle),
        recovery_largest_s=("recovery_s", "max"),
        ticks_without_command_median=("ticks_without_command", _middle),
        ticks_without_command_largest=("ticks_without_command", "max"),
        **{key: (key, "max") for key in ("longest_gap_s", "command_moves", "acting_moves")},
        safe_stops=("safe_stops", "sum"),
    )
    return records(faults.reset_index())


def summary(faults: dict[str, list[Row]]) -> str:
    """The worst of each kind of fault in each graph, as Markdown."""
    columns = {  # title, statistic over the parts, and format, by name in the rows
        "trials": ("trials", "sum", ".0f"),
        "recovered": ("recovered", "sum", ".0f"),
        "recovery_largest_s": ("longest recovery [s]", "max", ".1f"),
        "ticks_without_command_largest": ("most ticks without a command", "max", ".0f"),
        "longest_gap_s": ("longest time without a tick [s]", "max", ".1f"),
        "command_moves": (
            "largest distance of a command from the actual values [moves]",
            "max",
            ".2f",
        ),
        "safe_stops": ("safe stops", "sum", ".0f"),
    }
    titles, statistics, formats = zip(*columns.values(), strict=True)
    cells: list[tuple[object, ...]] = [("graph", "fault", *titles)]
    for graph, title in TITLES.items():
        parts = pd.DataFrame(faults[graph])
        kinds = parts.groupby(parts.fault.str.split().str[0])[list(columns)]
        worst = kinds.agg(dict(zip(columns, statistics, strict=True))).astype(float)
        cells += [
            (
                title,
                kind,
                *("–" if isnan(x) else f"{x:{f}}" for x, f in zip(row, formats, strict=True)),
            )
            for kind, *row in worst.itertuples()
        ]
    return table(cells, words=2)


def result(faults: dict[str, list[Row]], figures: Figures) -> str:
    """The result as Markdown, what was lost first."""
    rows = [row for of in faults.values() for row in of]
    slowest = max(rows, key=lambda row: row["recovery_largest_s"] or 0.0)
    lost = max(rows, key=lambda row: int(row["ticks_without_command_largest"]))
    count = {key: sum(row[key] for row in rows) for key in ("trials", "recovered", "safe_stops")}
    sums = {
        key: sum(int(figures[f"{graph}_{key}"] or 0) for graph in TITLES)
        for key in ("ticks", "ticks_without_command", "bags", "bags_readable")
    }
    return f"""**What is lost.** \
{count["trials"] - count["recovered"]} of {count["trials"]} trials did not recover.
{sums["ticks_without_command"]} of {sums["ticks"]} ticks had no command of a controller; \
most in one trial, \
{lost["ticks_without_command_largest"]}, after `{lost["fault"]}`. The longest recovery
was {slowest["recovery_largest_s"]:.1f} s, after `{slowest["fault"]}`; \
there were {count["safe_stops"]} safe stops. \
Of {sums["bags"]} bags {sums["bags_readable"]} are readable. The largest move of the
set-points that the machine accepted was {figures["machine_largest_move_taken"]:.2f}.

{summary(faults)}
"""


def figures_of(name: str, rows: list[Row], bags: Row) -> Figures:
    """The figures of one graph."""
    trials = pd.DataFrame(rows).astype({"recovery_s": float})
    totals = trials[["ticks", "ticks_without_command", "safe_stops", "operator_requests"]].sum()
    times_s = trials.recovery_s.dropna()
    figures = {
        "trials": len(rows),
        "without_recovery": int((~trials.recovered).sum()),
        "recovery_median_s": _middle(times_s) if len(times_s) else None,
        "recovery_largest_s": times_s.max() if len(times_s) else None,
        "largest_distance_of_a_command_in_moves": max(row["command_moves"] for row in rows),
        "largest_change_of_what_acts_in_moves": max(row["acting_moves"] for row in rows),
        **totals.to_dict(),
        **bags,
    }
    return {f"{name}_{key}": value for key, value in figures.items()}


def main() -> int:
    """Run the benchmark; returns the exit code: 1 when a trial had no recovery."""
    command = parser(__doc__, "10 trials per graph instead of 100")
    command.add_argument("--trials", type=int, help="per graph")
    command.add_argument("--seed", type=int, default=1)
    command.add_argument(
        "--out", type=Path, help="keep logs and bags in this folder, which must not exist"
    )
    command.add_argument(
        "--publish", action="store_true", help="write docs/results/random-faults.md"
    )
    arguments = command.parse_args()
    trials = arguments.trials or (10 if arguments.quick else 100)
    done, results = 0, {}

    with tempfile.TemporaryDirectory() as scratch, ProgressBar("random faults") as bar:
        folder = arguments.out or Path(scratch) / "faults"
        folder.mkdir(parents=True)

        def tell() -> None:
            nonlocal done
            done += 1
            bar(done / (2 * trials))

        def work(name: str, parts: Sequence[str], seed: int) -> None:
            results[name] = run(parts, folder / name, trials, seed, tell)

        sides = [("plant", EMULATOR, arguments.seed), ("machine", MACHINE, arguments.seed + 1)]
        threads = [threading.Thread(target=work, args=side) for side in sides]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    figures = {
        key: value
        for name, (rows, bags) in results.items()
        for key, value in figures_of(name, rows, bags).items()
    }
    faults = {name: by_fault(rows) for name, (rows, _) in results.items()}
    text = result(faults, figures)
    print(text)
    if arguments.publish:
        publish(RESULT.name, MARK, text)
        TABLES.write_text(in_lines(faults), encoding="utf-8")
    show(figures)
    save({**figures, "rows": {name: rows for name, (rows, _) in results.items()}}, arguments.json)
    return int(
        len(results) < len(sides)
        or any(value for key, value in figures.items() if key.endswith("recovery"))
    )


if __name__ == "__main__":
    sys.exit(main())
