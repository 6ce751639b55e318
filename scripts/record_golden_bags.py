#!/usr/bin/env python3
"""Records the golden bags of the regression test anew: one small bag per paper scenario, with its figures of merit.

usage: record_golden_bags.py [SCENARIO ...]

To be run when a change of plant or controllers is meant to change the welds; ``test/test_golden_bags.py`` then holds
the new ones.
"""

import json
import shutil
import sys
import tempfile
from pathlib import Path

from _bootstrap import WORKSPACE, ensure

SCENARIOS = (
    "open_loop_force_steps",
    "open_loop_speed_steps",
    "reference_tracking",
    "output_disturbances",
    "model_uncertainty",
)
CONTROLLER = "decentral"
TOPICS = "/fsw/(depth|spindle_torque|thermocouple|reference|command|plant/truth|supervisor/state|[a-z_]+/proposal)"
ATTACHMENTS = ("scenario.yaml", f"parameters/fsw_{CONTROLLER}.yaml")
GOLDEN = WORKSPACE / "test" / "golden"
LARGEST_BYTES = 1_000_000


def record(name: str, target: Path) -> None:
    """Run a scenario in lockstep over DDS and keep what a replay and the figures of merit need."""
    from fsw_experiment import kpi
    from fsw_experiment.graph import WeldGraph
    from fsw_experiment.launcher import Launcher, free_domain
    from fsw_experiment.scenario_file import load, parse
    from fsw_experiment.weld_events import cut_to_scenario
    from fsw_recorder.bag_writer import WriterOptions
    from fsw_recorder.salvage import salvage
    from fsw_recorder.signals import load_weld
    from fsw_recorder.topic_selection import TopicSelection

    scenario = load(name)
    if not scenario.open_loop:
        scenario = parse(scenario.text, scenario.name, [f"controller={CONTROLLER}"])
    with tempfile.TemporaryDirectory(prefix="fsw_golden_") as folder:
        graph = WeldGraph(scenario, Path(folder), () if scenario.open_loop else (CONTROLLER,))
        with free_domain() as domain, Launcher(Path(folder) / "log", domain) as launcher:
            graph.run(launcher)
        shutil.rmtree(target, ignore_errors=True)
        salvage(
            graph.bag,
            target,
            WriterOptions(compression="zstd"),
            selection=TopicSelection(regex=TOPICS),
            keep_attachment=lambda file: file in ATTACHMENTS,
        )
    result = kpi.compute(cut_to_scenario(load_weld(target)), name)
    (target / "kpi.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    size = sum(file.stat().st_size for file in target.iterdir())
    print(f"{target.relative_to(WORKSPACE)}: {size} bytes, {result['ticks']} ticks")
    if size > LARGEST_BYTES:
        raise SystemExit(f"{target}: larger than {LARGEST_BYTES} bytes; shorten the scenario or record fewer topics")


def main() -> int:
    """Record the scenarios that are named, or all."""
    names = sys.argv[1:] or list(SCENARIOS)
    unknown = [name for name in names if name not in SCENARIOS]
    if unknown:
        print(f"no golden scenario {', '.join(unknown)}; there are {', '.join(SCENARIOS)}", file=sys.stderr)
        return 2
    for name in names:
        record(name, GOLDEN / name)
    return 0


if __name__ == "__main__":
    ensure()
    sys.exit(main())
