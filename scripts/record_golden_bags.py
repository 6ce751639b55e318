#!/usr/bin/env python3
"""Records the golden bags of the regression test again.

One small bag per paper scenario, with its figures of merit.

usage: record_golden_bags.py [BAG ...]

In closed loop the predictive controller welds and the decentralized one runs in shadow, so that a
bag tests both; one scenario is welded by the decentralized controller as well.

To be run when a change of plant or controllers is meant to change the welds;
``test/test_golden_bags.py`` then holds the new ones.
"""

import contextlib
import json
import shutil
import sys
import tempfile
from pathlib import Path

from _bootstrap import WORKSPACE, ensure

if __name__ == "__main__":
    ensure()

from fsw_analysis import kpi
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.signals import load_weld
from fsw_control.free_domain import free_domain
from fsw_control.sensors import SENSORS
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import WriterOptions
from fsw_recorder.recover import recover
from fsw_recorder.topic import TopicSelection
from fsw_recorder.weld_clock import is_ticking, stamp_ns
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import load

#: bag: scenario, and the controller that welds in closed loop
BAGS = {
    "open_loop_force_steps": ("open_loop_force_steps", ""),
    "open_loop_speed_steps": ("open_loop_speed_steps", ""),
    "reference_tracking": ("reference_tracking", "nmpc"),
    "reference_tracking_decentral": ("reference_tracking", "decentral"),
    "output_disturbances": ("output_disturbances", "nmpc"),
    "model_uncertainty": ("model_uncertainty", "nmpc"),
}
TOPICS = (
    f"/({'|'.join(row.topic for row in SENSORS.values())}|"
    "fsw/(drives|reference|command|plant/truth|supervisor/(state|reference)|[a-z_]+/proposal))"
)
ATTACHMENTS = ("scenario.yaml", "parameters/fsw_nmpc.yaml", "parameters/fsw_decentral.yaml")
GOLDEN = WORKSPACE / "test" / "golden"
LARGEST_BYTES = 1_100_000


def record(name: str, target: Path) -> None:
    """Run a bag's scenario in lockstep over DDS; keep what replay and figures of merit need."""
    scenario_name, controller = BAGS[name]
    scenario = load(scenario_name, [f"controller={controller}"] if controller else [])
    with tempfile.TemporaryDirectory(prefix="fsw_golden_") as folder:
        graph = WeldGraph(scenario, Path(folder), ("decentral",) if controller else ())
        with free_domain() as domain, Launcher(Path(folder) / "log", domain) as launcher:
            graph.run(launcher)
        shutil.rmtree(target, ignore_errors=True)
        with contextlib.chdir(folder):  # the new bag names its source
            recover(
                graph.bag.relative_to(folder),
                target,
                WriterOptions(compression="zstd"),
                stop_ns=end_of_scenario(graph.bag, scenario.duration_s),
                selection=TopicSelection(regex=TOPICS),
                keep_attachment=lambda file: file in ATTACHMENTS,
            )
    result = kpi.compute(cut_to_scenario(load_weld(target)), name)
    (target / "kpi.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    size = sum(file.stat().st_size for file in target.iterdir())
    print(f"{target.relative_to(WORKSPACE)}: {size} bytes, {result['ticks']} ticks")
    if size > LARGEST_BYTES:
        raise SystemExit(
            f"{target}: larger than {LARGEST_BYTES} bytes; "
            "shorten the scenario or record fewer topics"
        )


def end_of_scenario(bag: Path, duration_s: float) -> int:
    """Time after which no message of the scenario's ticks was received.

    Topics overtake each other.
    """
    last_ns, end_ns = round((duration_s + 0.05) * 1e9), 0
    with BagReader(bag) as reader:
        for record in reader.records():
            if is_ticking(record.topic) and (stamp_ns(record.data) or 0) <= last_ns:
                end_ns = record.log_time_ns + 1
    return end_ns


def main() -> int:
    """Record the bags that are named, or all."""
    names = sys.argv[1:] or list(BAGS)
    if unknown := [name for name in names if name not in BAGS]:
        print(f"no golden bag {', '.join(unknown)}; there are {', '.join(BAGS)}", file=sys.stderr)
        return 2
    for name in names:
        record(name, GOLDEN / name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
