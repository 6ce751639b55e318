#!/usr/bin/env python3
"""Whether every tick of every weld is in its bag, and no finished weld is discarded, on a machine that is overloaded.

usage: recorded.py [--quick] [--welds N] [--at-a-time N] [--busy N] [--scenario NAME] [--json FILE]

Lockstep welds as processes under the NMPC, with the decentralized controller beside it and a
recorder; further processes do nothing but compute. A weld is discarded when its run fails. The
ticks that each topic lacks come from the stamps in the bag: a tick is what any topic has, and the
plant's topics have at least those of the scenario.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

from report import Figures, parser, save, show

from fsw_analysis.messages import SENSOR_TOPICS
from fsw_analysis.tick_gaps import TickCounter, TickGaps
from fsw_control.free_domain import free_domain
from fsw_control.weld import TICK_S
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher, LaunchError
from fsw_scenario.scenario_file import Scenario, load

#: of each tick the plant sends these
FROM_PLANT = (*SENSOR_TOPICS.values(), "/fsw/drives", "/fsw/plant/truth")
#: and the others answer with these; only the last tick of a weld may be without an answer
ANSWERS = (
    "/fsw/command",
    *(
        f"/fsw/{name}/{topic}"
        for name in ("decentral", "nmpc")
        for topic in ("proposal", "status")
    ),
)


def weld(scenario: Scenario, folder: Path) -> Counter[str]:
    """Run one weld, and count what its bag lacks."""
    graph = WeldGraph(scenario, folder, ("decentral", "nmpc"))
    found: Counter[str] = Counter(welds=1, load=round(os.getloadavg()[0]))
    try:
        with free_domain() as domain, Launcher(folder / "log", domain) as launcher:
            graph.run(launcher)
        found.update(lacking(graph.bag, round(scenario.duration_s / TICK_S)))
    except (LaunchError, BagError) as error:
        found["discarded"] += 1
        print(f"{folder.name}: {error}", file=sys.stderr)
    print(f"{folder.name}: {dict(found)}", file=sys.stderr)
    return found


def lacking(bag: Path, ticks: int) -> Counter[str]:
    """Ticks that the topics of a bag lack of those that any of them has, and ticks of the scenario that none has."""
    counter, messages = TickCounter(), Counter[str]()
    with BagReader(bag) as reader:
        for record in reader.records():
            counter.note(record)
            messages[record.topic] += 1
        remarks = len(reader.problems)
    found, gaps = Counter(ticks=ticks, remarks=remarks), counter.gaps()
    for topic in (*FROM_PLANT, *ANSWERS):
        own = gaps.get(topic, TickGaps(0, 0, ticks, 0))
        found[topic] = own.before + own.missing + max(0, own.after - (topic in ANSWERS))
        if found[topic]:
            print(f"{bag}: {topic}: {own}", file=sys.stderr)
    for topic in FROM_PLANT:
        found[topic] += max(0, ticks - messages[topic])
    return found


def measure(welds: int, at_a_time: int, busy: int, name: str, folder: Path) -> Figures:
    """Run all welds beside busy processes; the sums."""
    scenario = load(name, ["controller=nmpc"])
    with ExitStack() as stack:
        for _ in range(
            busy
        ):  # each in a session of its own: the kernel shares the cores out by session
            process = subprocess.Popen(
                [sys.executable, "-c", "while True: pass"], start_new_session=True
            )
            stack.callback(process.kill)
        with ThreadPoolExecutor(at_a_time) as pool:
            found = list(
                pool.map(lambda number: weld(scenario, folder / f"weld{number}"), range(welds))
            )
    total = sum(found, Counter[str]())
    counts = {name: total[name] for name in ("welds", "ticks", "discarded", "remarks")}
    missing = {f"missing {topic}": total[topic] for topic in (*FROM_PLANT, *ANSWERS)}
    return (
        counts
        | {"missing": sum(missing.values())}
        | missing
        | {"load_mean": total["load"] / welds}
    )


def main() -> None:
    """Run the benchmark."""
    words = parser(__doc__, quick="two welds")
    words.add_argument("--welds", type=int, default=60)
    words.add_argument("--at-a-time", type=int, default=3)
    words.add_argument(
        "--busy", type=int, default=4, help="processes that compute beside the welds"
    )
    words.add_argument("--scenario", default="quick")
    parsed = words.parse_args()
    welds = 2 if parsed.quick else parsed.welds
    with tempfile.TemporaryDirectory() as place:
        figures = measure(welds, parsed.at_a_time, parsed.busy, parsed.scenario, Path(place))
    show(figures)
    save(figures, parsed.json)


if __name__ == "__main__":
    main()
